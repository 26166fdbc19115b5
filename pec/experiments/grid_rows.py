"""The cells of a grid joined over their seeds, and the names of what they differ in."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pec.common.run_identity import flat_settings
from pec.experiments.grid import read_cells

__all__ = [
    "Row",
    "differing_settings",
    "group_of",
    "order_name",
    "other_settings",
    "protocol_name",
    "read_rows",
    "size_name",
]


@dataclass(frozen=True)
class Row:
    """Cells that differ in nothing but their seed. Lists have one value a seed that is done; accuracies in [0, 1]."""

    settings: dict[str, Any]
    """Resolved, without the seed."""
    seeds: list[int]
    results: list[dict[str, Any]]
    missing: list[str]
    """Of the seeds that are not done, which and why."""

    @property
    def points(self) -> int:
        return self.settings["preprocess"]["n_points"]

    @property
    def model(self) -> str:
        return self.settings["model"]["name"]

    @property
    def order(self) -> str:
        return order_name(self.settings["preprocess"])

    @property
    def protocol(self) -> str:
        return protocol_name(self.settings["protocol"])

    @property
    def precision(self) -> str:
        """Of the products in training, as asked, or what "auto" came to; cells older than the choice say nothing."""
        asked = str(self.settings["protocol"].get("precision", "float32"))
        used = {result["precision"]["used"] for result in self.results}
        return " and ".join(sorted(used)) if asked == "auto" and used else asked

    @property
    def name(self) -> str:
        name = f"{self.model}, {self.points} points, {self.order}, {self.protocol}"
        return name if self.precision == "float32" else f"{name}, {self.precision}"

    def values(self, *path: str) -> list[float]:
        """What results.json has at `path`, of every seed that is done."""
        found: list[Any] = list(self.results)
        for name in path:
            found = [value[name] for value in found]
        return found


def protocol_name(protocol: Mapping[str, Any]) -> str:
    """ "honest" or "published", of `ProtocolConfig` as a mapping."""
    return "honest" if protocol["selection"] == "validation" else "published"


def order_name(preprocess: Mapping[str, Any]) -> str:
    """ "groups of 16", "no grouping", or the ordering and the pose that are ours, of `Preprocess` as a mapping; and the
    size where it is not the published one."""
    size = size_name(preprocess)
    if preprocess["ordering"] == "groups":
        return f"groups of {preprocess['group_size']}{size}"
    if preprocess["ordering"] == "none":
        return f"no grouping{size}"
    return f"{preprocess['ordering']}, {preprocess['pose']} pose{size}"


def size_name(preprocess: Mapping[str, Any]) -> str:
    """ ", root size", of `Preprocess` as a mapping; "" for the published size."""
    size = preprocess.get("size", "kept")  # the default, which a configuration need not name
    return "" if size == "kept" else f", {size} size"


def read_rows(folder: str | os.PathLike[str]) -> list[Row]:
    """The cells of `folder` that the present code made, joined over their seeds."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for cell in read_cells(folder):
        settings = {name: value for name, value in cell["settings"].items() if name != "seed"}
        groups.setdefault(json.dumps([settings, cell["data"]], sort_keys=True), []).append(cell)
    rows = []
    for cells in groups.values():
        cells.sort(key=lambda cell: cell["settings"]["seed"])
        done = [cell for cell in cells if cell["status"] == "done"]
        rows.append(
            Row(
                {name: value for name, value in cells[0]["settings"].items() if name != "seed"},
                [cell["settings"]["seed"] for cell in done],
                [cell["results"] for cell in done],
                [
                    f"seed {cell['settings']['seed']}: {cell['error'] or cell['status']}"
                    for cell in cells
                    if cell["status"] != "done"
                ],
            )
        )
    return sorted(rows, key=lambda row: (row.settings["model"]["name"], row.protocol, row.points, group_of(row) or 1e9))


def group_of(row: Row) -> int | None:
    """Points in a group; None where there is no grouping."""
    preprocess = row.settings["preprocess"]
    return preprocess["group_size"] if preprocess["ordering"] == "groups" else None


def differing_settings(rows: Sequence[Row]) -> list[str]:
    """Names of settings that are not the same in all rows and that no column says."""
    said = ("model.", "preprocess.", "protocol.selection", "protocol.epochs", "protocol.precision")
    flat = [flat_settings(row.settings) for row in rows]
    names = sorted({name for settings in flat for name in settings if not name.startswith(said)})
    return [name for name in names if len({str(settings.get(name)) for settings in flat}) > 1]


def other_settings(row: Row, differing: Sequence[str]) -> str:
    """The `differing` settings of a row; one that it does not name has its default."""
    flat = flat_settings(row.settings)
    return ", ".join(f"{name}={flat[name]}" for name in differing if name in flat)
