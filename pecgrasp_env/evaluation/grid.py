"""A grid of evaluations whose cells are kept: `run_cell` runs the episodes of one, `read_cells` finds them all again.

FOLDER/cells/KEY/cell.json                  what the cell is, and what it failed of if it did
FOLDER/cells/KEY/episodes.jsonl             a line an episode; episodes.IofN.jsonl while jobs share the cell
FOLDER/cells/KEY/failures/SEED.KIND.webp    pictures of each episode that failed

KEY is the hash of the cell's resolved settings, its classifier and the code: the same command goes on where it was
interrupted, and a cell whose settings, classifier or code have changed is another cell.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pec.common.atomic_files import write_json
from pec.common.run_identity import settings_key
from pec.experiments.code_version import code_version
from pecgrasp_env.common.job_share import JobShare
from pecgrasp_env.common.planner_networks import checkpoint_key, network_keys
from pecgrasp_env.evaluation.episode import Episode
from pecgrasp_env.evaluation.run import Protocol, read_episodes, run_episodes

_DECISIVE = ("env", "planner", "policy", "first_seed", "sockets")

# From these on, imports lead to all that has a part in an episode; `grasping` to every planner.
_CODE = (
    (
        "pecgrasp_env.evaluation.episode",
        "pecgrasp_env.envs.selective_grasp",
        "pecgrasp_env.policy.scripted",
        "pec.classifier",
        "pec.grasps",
    ),
    ("mani-skill", "sapien", "torch", "numpy", "scipy"),
)


@dataclass(frozen=True)
class Cell:
    """One cell. scene, planner: what the tables call its row and column. episodes: those asked for that are done.

    wanted: how many were asked for. error: what the cell failed of when it was run last, or None.
    """

    key: str
    folder: Path
    scene: str
    planner: str
    settings: dict[str, Any]
    episodes: list[Episode]
    wanted: int
    error: str | None

    @property
    def failures(self) -> Path:
        """The folder of the pictures."""
        return self.folder / "failures"


@cache
def cell_code() -> str:
    """The version of the code that cells are made by."""
    return code_version(*_CODE)


def run_cell(settings: Mapping[str, Any], progress: Callable[[int, int], None] | None = None) -> Cell:
    """Run what is missing of one cell below settings["folder"], or of its share settings["shard"].

    progress: as of `run_episodes`.
    Whatever the cell fails of is written down and returned, not raised: the others of its grid go on.
    """
    key = cell_key(settings)
    directory = Path(settings["folder"]) / "cells" / key
    directory.mkdir(parents=True, exist_ok=True)
    record = {
        "scene": settings["scene"],
        "planner": settings["planner_name"],
        "settings": {name: settings[name] for name in (*_DECISIVE, "checkpoint", "episodes")},
        "code": cell_code(),
        "error": None,
    }
    write_json(directory / "cell.json", record)
    protocol = Protocol(
        settings["env"], settings["checkpoint"], settings["planner"], settings["policy"], settings["sockets"]
    )
    first = settings["first_seed"]
    try:
        run_episodes(
            protocol,
            range(first, first + settings["episodes"]),
            directory,
            workers=settings["workers"],
            share=None if settings["shard"] is None else JobShare.parse(settings["shard"]),
            pictures=settings["pictures"],
            progress=progress,
        )
    except Exception as error:  # of any kind: a missing classifier is this cell's failure, not the grid's
        record["error"] = f"{type(error).__name__}: {error}"
        write_json(directory / "cell.json", record)
    return _read_cell(directory)


def cell_key(settings: Mapping[str, Any]) -> str:
    """16 hexadecimal digits that differ where the settings, the classifier, the planner's networks or the code do."""
    decisive = {name: settings[name] for name in _DECISIVE}
    classifier = None if settings["checkpoint"] is None else checkpoint_key(settings["checkpoint"])
    return settings_key(decisive, classifier, network_keys(settings["planner"]), cell_code())


def read_cells(folder: str | os.PathLike[str]) -> list[Cell]:
    """The cells below `folder` that the present code made."""
    paths = sorted(Path(folder).glob("cells/*/cell.json"))
    return [_read_cell(path.parent) for path in paths if json.loads(path.read_text())["code"] == cell_code()]


def _read_cell(directory: Path) -> Cell:
    record = json.loads((directory / "cell.json").read_text())
    first, wanted = record["settings"]["first_seed"], record["settings"]["episodes"]
    episodes = [e for e in read_episodes(directory) if first <= e.seed < first + wanted]
    return Cell(
        directory.name,
        directory,
        record["scene"],
        record["planner"],
        record["settings"],
        episodes,
        wanted,
        record["error"],
    )
