"""Golden items of data sets and classifiers, made by the scripts, and of what an earlier version left of both."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from golden_digest import Values
from golden_grasping import cases
from golden_tools import read_json, run_script, without_times

from pec import Classifier

SETS = [(scenario, sensor) for scenario in ("free", "tabletop") for sensor in ("d435", "ideal")]
RUNS = {
    "pec": ["model=pec"],
    "pec2": ["model=pec2"],
    "published": ["model=pec", "preprocess=published_g16", "protocol=published", "augment=none"],
}


def data_sets(work: Path) -> Values:
    """All files of data sets by scripts/generate_dataset.py, but for the data card and the logs."""
    for scenario, sensor in SETS:
        make_data(work, scenario, sensor)
        yield from files_of_data(work / "data" / f"{scenario}_{sensor}")


def make_data(work: Path, scenario: str, sensor: str) -> Path:
    """The folder of a small data set, made where it is not there."""
    out = work / "data" / f"{scenario}_{sensor}"
    if not out.exists():
        samples = 16 if (scenario, sensor) == ("tabletop", "d435") else 3
        sizes = [f"samples_per_instance={samples}", "instances_per_class=2", "shard_size=24", "tabletop.drops=4"]
        quiet = ["workers=1", "progress=false"]
        choices = [f"scenario={scenario}", f"sensor={sensor}", "sensor.resolution=424x240", f"out=data/{out.name}"]
        run_script(work, "generate_dataset.py", *choices, *sizes, *quiet)
    return out


def files_of_data(folder: Path) -> Values:
    for path in sorted(each for each in folder.rglob("*") if each.suffix in (".json", ".safetensors")):
        content = path.read_bytes() if path.suffix == ".safetensors" else without_times(read_json(path))
        yield f"{folder.name}/{path.relative_to(folder)}", content


def trained(work: Path) -> Values:
    """Weights, moments and results of three epochs by scripts/train.py."""
    for name in RUNS:
        yield from files_of_run(train(work, name))


def train(work: Path, name: str, data: Path | None = None) -> Path:
    """The folder of a run on the tabletop data, which is made, continued or only found. data: another copy of them."""
    where = make_data(work, "tabletop", "d435").relative_to(work) if data is None else data
    small = ["protocol.epochs=3", "device=cpu", "threads=1", "progress=false", "cache=cache"]
    small += [] if name == "published" else ["protocol.batch_size=32"]
    out = Path("runs") / (name if data is None else f"{name}_again")
    run_script(work, "train.py", f"dataset.path={where}", f"output={out}", *RUNS[name], *small)
    return work / out


def files_of_run(folder: Path) -> Values:
    """Only where the run lies and how long it took is left out."""
    tensors = sorted(folder.rglob("*.safetensors"))
    texts = sorted(path for path in folder.rglob("*.json") if path.name in ("config.json", "progress.json"))
    for path in [*tensors, *texts, folder / "results.json"]:
        content = path.read_bytes() if path.suffix == ".safetensors" else without_times(read_json(path))
        if path.name != "config.json" and path.suffix == ".json":
            content.pop("checkpoint", None)
            del content["config"]["dataset"]["path"]
        yield f"{folder.name}/{path.relative_to(folder)}", content


def predictions(work: Path) -> Values:
    for name in RUNS:
        folder = work / "runs" / name
        yield from predictions_of(name, folder if folder.exists() else train(work, name))


def predictions_of(name: str, run: Path) -> Values:
    """Of a run's best checkpoint on 50 clouds, alone and together."""
    clouds = [case.points.astype(np.float32) for case in cases(50)]
    classifier = Classifier.load(run / "best", unknown_below=0.3)
    for number, together in enumerate(classifier.predict(clouds)):
        yield f"{name} {number:02d}", [together, classifier.predict(clouds[number])]


def old_files(work: Path, old: Path) -> Values:
    """What an earlier version kept: its data give the same weights, its runs go on, its checkpoints answer."""
    yield from files_of_run(train(work, "pec", old / "data" / "tabletop_d435"))
    for name in RUNS:
        yield from predictions_of(name, old / "runs" / name)
    copy = Path(shutil.copytree(old, work / "old"))
    (copy / "runs" / "pec" / "results.json").unlink()  # so that its last state is read, and calibrated again
    yield from (("resumed " + name, value) for name, value in files_of_run(train(copy, "pec")))
