"""Running the checkout's scripts, and reading what they leave."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def run_script(work: Path, name: str, *choices: str) -> None:
    """Run one of the checkout's scripts in the work folder, so that paths in its results are relative to it."""
    done = subprocess.run([sys.executable, ROOT / "scripts" / name, *choices], cwd=work, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{name} {' '.join(choices)}:\n{done.stdout}{done.stderr}")


def read_json(path: Path) -> Any:
    return json.loads(path.read_text())


def without_times(content: Any) -> Any:
    """JSON without the package's own version and without what a clock measured."""
    if isinstance(content, list):
        return [without_times(each) for each in content]
    if not isinstance(content, dict):
        return content
    clocked = ("pecgrasp", "seconds", "clouds_per_second", "training_s")
    return {
        name: without_times(each) for name, each in content.items() if name not in clocked and not name.endswith("_ms")
    }
