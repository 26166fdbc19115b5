"""From a folder of meshes to a classifier, without labelling anything.

    python examples/04_own_meshes.py

The folder holds MESHES/<class>/<instance>.{obj,ply,stl,glb}; here three classes of two simple meshes are written into
one. The settings are small, so that it takes seconds. With your own meshes, and settings that are worth something:

    pecgrasp generate objects.path=MESHES out=clouds
    pecgrasp train dataset.path=clouds output=classifier
"""

import tempfile
from pathlib import Path

import trimesh

from pec import Classifier
from pec.data.loading import load_dataset
from pec.training import train
from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, generate

MESHES = {
    "plate": [trimesh.creation.box((0.18, 0.12, 0.02)), trimesh.creation.box((0.16, 0.13, 0.03))],
    "rod": [trimesh.creation.cylinder(0.015, 0.18), trimesh.creation.cylinder(0.012, 0.15)],
    "ball": [trimesh.creation.icosphere(2, 0.04), trimesh.creation.icosphere(2, 0.035)],
}


def main(folder: Path) -> None:
    for name, meshes in MESHES.items():
        (folder / "meshes" / name).mkdir(parents=True)
        for i, mesh in enumerate(meshes):
            mesh.export(folder / "meshes" / name / f"{name}_{i}.ply")

    # "free" shows each object in any pose in the air; the default of the command, "tabletop", transfers better.
    objects = ObjectsConfig(source="folder", path=str(folder / "meshes"))
    config = CaptureConfig(scenario="free", objects=objects, samples_per_instance=60, sensor="d435", max_depth=1.0)
    generation = generate(config, folder / "clouds", workers=1)
    print(f"labelled clouds: {generation.directory}")

    settings = {"dataset": {"path": str(folder / "clouds")}, "protocol": {"epochs": 40, "batch_size": 32}}
    results = train({**settings, "output": str(folder / "classifier"), "progress": False})
    print(f"test accuracy: {100 * results['best']['test_accuracy']:.0f} %, on other clouds of the same six objects")

    classifier = Classifier.load(results["checkpoint"])
    clouds = load_dataset(folder / "clouds")
    for i in range(0, len(clouds), 60):
        print(f"a {clouds.classes[clouds.labels[i]]} is called {classifier.predict(clouds.clouds[i]).label}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
