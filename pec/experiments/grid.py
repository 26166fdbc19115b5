"""A grid of training runs whose cells are kept: `run_cell` trains one, `write_table` sets them side by side.

FOLDER/cells/KEY/cell.json      what the cell is; "done", "unfinished" or "failed", and why
FOLDER/cells/KEY/results.json   and all else that `pec.training.loop` leaves there
FOLDER/table.md, table.csv, results.json, *.svg    what `write_table` makes of the cells of the present code

KEY is the hash of the cell's resolved settings, its data and the code: a cell that is done is not run again, one that
was interrupted goes on, and one whose settings, data or code have changed is another cell.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pec.common.atomic_files import write_json
from pec.common.run_identity import settings_key
from pec.data.loading import data_version
from pec.experiments.code_version import code_version
from pec.training.loop import train

__all__ = ["cell_code", "cell_key", "read_cells", "run_cell"]

# What leaves the numbers of a cell as they are: where it runs and lies, and what the table calls it.
_BESIDE = ("output", "threads", "device", "cache", "progress", "name", "folder", "table")

# From here on, imports lead to all that has a part in a cell's numbers.
_CODE = (("pec.training.loop",), ("torch", "numpy"))


@cache
def cell_code() -> str:
    """The version of the code that cells are made by."""
    return code_version(*_CODE)


def run_cell(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Train one cell below settings["folder"], unless it is done; returns what its cell.json says.

    Whatever a cell fails of is written down and returned, not raised: the others of its grid go on.
    """
    key = cell_key(settings)
    directory = Path(settings["folder"]) / "cells" / key
    if (directory / "results.json").is_file():
        earlier = json.loads((directory / "cell.json").read_text())
        if earlier["status"] == "done":  # and stays so at every moment, for tables that are written meanwhile
            return {"key": key, **earlier}
    directory.mkdir(parents=True, exist_ok=True)
    cell = {
        "status": "unfinished",
        "error": None,
        "settings": _decisive(settings),
        "data": data_version(settings["dataset"]["path"]),
        "code": cell_code(),
    }
    write_json(directory / "cell.json", cell)
    known = {name: value for name, value in settings.items() if name not in ("name", "folder", "table")}
    try:
        train({**known, "output": str(directory)})
        cell["status"] = "done"
    except Exception as error:  # of any kind: a full disk or a full GPU is this cell's failure, not the grid's
        cell["status"], cell["error"] = "failed", f"{type(error).__name__}: {error}"
    write_json(directory / "cell.json", cell)
    return {"key": key, **cell}


def cell_key(settings: Mapping[str, Any]) -> str:
    """16 hexadecimal digits that differ where the settings, the data or the code do."""
    return settings_key(_decisive(settings), data_version(settings["dataset"]["path"]), cell_code())


def read_cells(folder: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """The cells below `folder` that the present code made: cell.json each, with its `key` and, if done, `results`."""
    cells = []
    for path in sorted(Path(folder).glob("cells/*/cell.json")):
        cell = json.loads(path.read_text())
        if cell["code"] == cell_code():
            done = cell["status"] == "done"
            results = json.loads((path.parent / "results.json").read_text()) if done else None
            cells.append({"key": path.parent.name, **cell, "results": results})
    return cells


def _decisive(settings: Mapping[str, Any]) -> dict[str, Any]:
    decisive = {name: value for name, value in settings.items() if name not in _BESIDE}
    # The data count by what they hold, not by where they lie.
    return decisive | {"dataset": {name: value for name, value in settings["dataset"].items() if name != "path"}}
