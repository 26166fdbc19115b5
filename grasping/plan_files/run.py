"""From files with clouds to grasps: read, segment where it is a scene, plan on each object, say what came of it.

A file that cannot be read or planned on does not stop the others: its `error` says why.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from grasping.cloud_files import SUFFIXES
from grasping.errors import CloudError, ConfigError
from grasping.plan_files.json_results import as_results
from grasping.plan_files.page import plan_page
from grasping.plan_files.plan_file import Task, plan_file
from grasping.plan_files.text_table import HEADER, table_lines


def frame_up(frame: str) -> tuple[float, float, float] | None:
    """Where up is in a frame of this name: "world" has it along z, in a "camera"'s frame it is not known.

    Raises ConfigError for another name.
    """
    if frame not in ("camera", "world"):
        raise ConfigError(f"frame = {frame!r} must be camera or world; up=[x,y,z] says anything else")
    return (0.0, 0.0, 1.0) if frame == "world" else None


def cloud_paths(path: str | os.PathLike[str]) -> list[Path]:
    """The file itself, or all files of a folder that are clouds by their suffix, by name.

    Raises FileNotFoundError where there is nothing, CloudError for a folder without a cloud.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"cloud {path} does not exist")
    if not path.is_dir():
        return [path]
    found = sorted(each for each in path.iterdir() if each.suffix.lower() in SUFFIXES and each.is_file())
    if not found:
        raise CloudError(f"{path}: no file of this folder ends in {', '.join(SUFFIXES)}")
    return found


def plan_files(
    paths: Sequence[Path], task: Task, output: Path, say: Callable[[str], None] = print, command: str = ""
) -> dict[str, Any]:
    """Plan on each file; say a table; leave `results.json` and `plan.html` in the folder, and return the results."""
    say(HEADER)
    files = []
    for path in paths:
        files.append(plan_file(path, task))
        for line in table_lines(files[-1]):
            say(line)
    output.mkdir(parents=True, exist_ok=True)
    results = as_results(files, task)
    write_whole(output / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")
    write_whole(output / "plan.html", plan_page(files, task.gripper, type(task.planner).__name__, task.up, command))
    return results


def write_whole(path: Path, text: str) -> None:
    """Put the text in place of what the file held, whole or not at all."""
    # As pec.common.atomic_files does it, which this package must not import.
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
