"""Train a classifier on clouds of your own, and ask it what a cloud shows, from Python.

    python examples/03_classify.py

The clouds are drawn here, so that it takes seconds; yours come from a camera, or from example 04. Needs `grasping` and
`pec` (`pip install '.[learn]'`).
"""

import tempfile
from pathlib import Path

import numpy as np

from pec import Classifier
from pec.data.shards import CloudSample, Manifest, shard_name, write_manifest, write_shard
from pec.training import train

SIZES = {"ball": (0.05, 0.05, 0.05), "plate": (0.09, 0.07, 0.004), "rod": (0.12, 0.01, 0.008)}  # half axes, m
CLASSES = list(SIZES)
rng = np.random.default_rng(0)


def cloud(name: str) -> np.ndarray:
    """(200, 3) float32 points on an ellipsoid in any orientation, half a metre before the camera."""
    points = rng.normal(size=(200, 3))
    points *= np.array(SIZES[name]) / np.linalg.norm(points, axis=1, keepdims=True)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return (points @ rotation.T + [0.0, 0.0, 0.5]).astype(np.float32)


def write_clouds(folder: Path, clouds_per_class: int = 60) -> None:
    """A data set as `pec` reads it: here a shard a class, and one object each."""
    records = []
    for label, name in enumerate(CLASSES):
        samples = [CloudSample(cloud(name), label, label, np.eye(4), i) for i in range(clouds_per_class)]
        records.append(write_shard(folder / shard_name(label), samples))
    instances = [{"name": f"{name}_0", "class": name} for name in CLASSES]
    write_manifest(folder, Manifest(CLASSES, instances, [{"name": "drawn"}], {}, 0, {}, records, complete=True))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_clouds(folder / "clouds")
        settings = {"dataset": {"path": str(folder / "clouds")}, "protocol": {"epochs": 15, "batch_size": 32}}
        results = train({**settings, "output": str(folder / "classifier"), "progress": False})
        print(f"test accuracy: {100 * results['best']['test_accuracy']:.0f} %")
        classifier = Classifier.load(results["checkpoint"])  # the folder is all that a robot needs

    for shown in CLASSES:
        answer = classifier.predict(cloud(shown))
        print(f"a {shown} is called {answer.label}, confidence {answer.confidence:.2f}")
