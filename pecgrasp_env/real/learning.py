"""How a checkpoint learns a class more: with all clouds of the training run that it came from, or without them.

A run goes on with the clouds of every class that was taught since, too, each kept by `pecgrasp teach` beside what it
left: so classes that are taught one after another end as if they had been taught at once.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from grasping.errors import DAMAGED_NPZ
from pecgrasp_env.real.connected import SettingError

CLOUDS = "clouds.npz"
RESULTS = "results.json"
FEWEST = 5  # clouds, with which a training run goes on


@dataclass(frozen=True)
class Origin:
    """What a checkpoint was trained on.

    run: output folder of `pecgrasp train`. taught: of each class since, in order, the folder that `pecgrasp teach`
    left.
    """

    run: Path
    taught: dict[str, Path] = field(default_factory=dict)

    def learn(self, name: str, clouds: Sequence[np.ndarray]) -> Any:
        """The `pec.Classifier` of the run with what was taught since and this class. Raises what `pec.training.fit`
        raises, SettingError where clouds that were taught are gone.
        """
        from pec.training import fit

        earlier = {each: read_clouds(folder) for each, folder in self.taught.items()}
        return fit(self.run, {**earlier, name: clouds}, progress=True)

    def as_json(self) -> dict[str, Any]:
        return {"run": str(self.run), "taught": {name: str(folder) for name, folder in self.taught.items()}}


def origin_of(checkpoint: Path, run: Path | None, classes: Sequence[str]) -> Origin | str:
    """What a checkpoint that knows ``classes`` was trained on, or why it cannot go on from that, in words.

    run: where that run's folder is, which then must do. Raises SettingError, or what `pec.training.fit` raises of it.
    """
    from pec.errors import CheckpointError, ConfigError, DatasetError
    from pec.training.more_classes import run_to_go_on

    beside = _json(checkpoint.parent / RESULTS)
    taught: dict[str, Path] = {}
    found = run
    if "config" in beside:
        found = found or checkpoint.resolve().parent
    elif "learnt_with" in beside:
        found = found or Path(beside["learnt_with"]["run"])
        taught = {name: Path(folder) for name, folder in beside["learnt_with"]["taught"].items()}
        taught[beside["name"]] = checkpoint.resolve().parent
    if found is None:
        return f"{checkpoint} lies in no training run's folder: run=… says where that is"
    try:
        known = [*run_to_go_on(found).checkpoint.classes, *taught]
        if known != list(classes):
            since = f" and what was taught since ({', '.join(taught)})" if taught else ""
            raise SettingError(
                f"run={found}: {checkpoint} knows {', '.join(classes)}; the run{since} {', '.join(known)}"
            )
        for folder in taught.values():
            read_clouds(folder)
    except (CheckpointError, ConfigError, DatasetError, SettingError) as error:
        if run is not None:
            raise
        return str(error)
    return Origin(found.resolve(), taught)


def write_clouds(folder: Path, clouds: Sequence[np.ndarray]) -> None:
    """Clouds (M, 3) as `read_clouds` reads them."""
    named: dict[str, Any] = {f"{k:03}": cloud for k, cloud in enumerate(clouds)}
    np.savez_compressed(folder / CLOUDS, **named)


def read_clouds(folder: Path) -> list[np.ndarray]:
    """What `write_clouds` wrote. Raises SettingError where it is gone."""
    try:
        with np.load(folder / CLOUDS) as held:
            return [held[key] for key in sorted(held)]
    except DAMAGED_NPZ as error:
        raise SettingError(f"{folder / CLOUDS}, of a class that was taught, cannot be read: {error}") from error


def _json(path: Path) -> dict[str, Any]:
    try:
        held = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return held if isinstance(held, dict) else {}
