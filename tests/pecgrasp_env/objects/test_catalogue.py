"""The catalogue: the same everywhere, different by seed, of plausible size, hulls on the surface."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from pecgrasp_env.objects import CLASSES, LARS_CLASSES, Catalogue, ObjectError, make_object, open_objects
from pecgrasp_env.objects.meshing.convex_hulls import convex_hull
from pecgrasp_env.objects.model import ObjectModel

# Longest, middle and shortest side in mm, kg: what shops sell.
PLAUSIBLE = {
    "joypad": ((138, 168), (95, 130), (38, 62), (0.15, 0.3)),
    "mouse": ((95, 130), (52, 72), (30, 48), (0.06, 0.15)),
    "pliers": ((130, 215), (45, 100), (10, 18), (0.12, 0.35)),
    "stapler": ((110, 160), (42, 75), (28, 42), (0.12, 0.4)),
    "plug_adapter": ((50, 85), (44, 66), (40, 62), (0.05, 0.2)),
    "can": ((70, 155), (50, 95), (28, 95), (0.1, 0.7)),
    "box": ((90, 175), (55, 110), (30, 65), (0.05, 0.7)),
    "bottle": ((160, 240), (58, 100), (52, 80), (0.2, 0.65)),
    "mug": ((95, 140), (80, 115), (70, 100), (0.2, 0.5)),
    "bowl": ((120, 170), (120, 170), (42, 75), (0.15, 0.5)),
    "clamp": ((105, 180), (60, 115), (16, 40), (0.06, 0.3)),
    "drill": ((160, 230), (150, 200), (50, 70), (0.7, 1.4)),
    "wire_cutter": ((95, 140), (35, 60), (9, 14), (0.05, 0.15)),
    "open_wire_cutter": ((85, 125), (70, 120), (9, 14), (0.05, 0.15)),
}

# A tenth of a second to half a second each, and of them every way in which shapes are made.
QUICK_TO_MAKE = ("pliers", "plug_adapter", "can", "mug", "bowl", "wire_cutter")


def fingerprint(model: ObjectModel) -> str:
    digest = hashlib.sha256(f"{model.class_name} {model.instance} {model.mass}".encode())
    for part in model.parts:
        digest.update(part.vertices.tobytes() + part.faces.tobytes() + repr(part.color).encode())
    for hull in model.hulls:
        digest.update(hull.tobytes())
    return digest.hexdigest()


@pytest.mark.parametrize("classes", [QUICK_TO_MAKE, pytest.param(CLASSES, marks=pytest.mark.slow)], ids=["some", "all"])
def test_the_same_object_in_another_process(classes):
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); from test_catalogue import *\n"
        "print(*(fingerprint(make_object(c, 2)) for c in sys.argv[2:]))"
    )
    command = [sys.executable, "-c", script, __file__.rsplit("/", 1)[0], *classes]
    other = subprocess.run(command, capture_output=True, text=True, check=True)
    assert other.stdout.split() == [fingerprint(make_object(c, 2)) for c in classes]


@pytest.mark.parametrize("class_name", CLASSES)
def test_instances_differ_and_are_of_plausible_size(class_name):
    models = [make_object(class_name, seed) for seed in range(3)]
    assert len({fingerprint(m) for m in models}) == 3
    extents = np.sort([m.extents for m in models], axis=1)[:, ::-1] * 1000
    assert (np.ptp(extents, axis=0) > 0.5).any()
    longest, middle, shortest, mass = PLAUSIBLE[class_name]
    for (low, high), sizes in zip((longest, middle, shortest), extents.T, strict=True):
        assert (sizes >= low).all()
        assert (sizes <= high).all()
    assert all(mass[0] <= m.mass <= mass[1] for m in models)
    # A bowl is taken by its rim; everything else fits between the fingers across its narrow side.
    assert class_name == "bowl" or (extents[:, 1] < 210).all()
    assert (extents[:, 2] < 110).all()
    for model in models:
        assert 300 < sum(len(p.faces) for p in model.parts) < 16000
        assert all(p.vertices.dtype == np.float32 and p.faces.dtype == np.int32 for p in model.parts)
        for hull in model.hulls:
            assert len(hull) <= 64  # vertices and faces: what PhysX takes on a GPU
            normals = np.round(convex_hull(hull.astype(float)).equations[:, :3], 3)
            assert len(np.unique(normals, axis=0)) <= 64


def outside_of(points: np.ndarray, hulls: list[np.ndarray]) -> np.ndarray:
    """Distance of each point outside the nearest of the hulls' faces, negative inside one."""
    nearest = np.full(len(points), np.inf)
    for equations in hulls:
        nearest = np.minimum(nearest, (points @ equations[:, :3].T + equations[:, 3]).max(axis=1))
    return nearest


@pytest.mark.parametrize("class_name", CLASSES)
def test_the_hulls_lie_on_the_surface_that_is_seen(class_name):
    model = make_object(class_name, 2)
    seen, _ = trimesh.sample.sample_surface(model.visual_mesh(), 40000, seed=0)
    equations = [convex_hull(h.astype(float)).equations for h in model.hulls]
    uncovered = outside_of(seen, equations) * 1000
    assert np.percentile(uncovered, 99) < 1.0
    assert uncovered.max() < 2.0

    # And not much more: the union's outer skin is near something that is seen.
    skin = []
    for i, hull in enumerate(model.hulls):
        mesh = trimesh.Trimesh(hull, convex_hull(hull.astype(float)).simplices, process=False)
        points, _ = trimesh.sample.sample_surface(mesh, max(30, int(mesh.area * 5e4)), seed=0)
        facet = (points @ equations[i][:, :3].T + equations[i][:, 3]).argmax(axis=1)
        lifted = points + 4e-4 * equations[i][facet, :3]
        others = equations[:i] + equations[i + 1 :]
        skin.append(points[outside_of(lifted, others) > 1e-4])
    standing_off = cKDTree(seen).query(np.concatenate(skin))[0] * 1000  # samples lie 1 mm apart
    assert np.percentile(standing_off, 95) < 2.0
    assert np.percentile(standing_off, 99) < 2.5
    assert standing_off.max() < 4.0


def test_hollow_things_are_hollow():
    for class_name in ("mug", "bowl"):
        model = make_object(class_name, 5)
        top = max(p.vertices[:, 2].max() for p in model.parts)
        axis = np.median(np.concatenate([p.vertices for p in model.parts])[:, :2], axis=0)
        probe = np.array([[*axis, top - 0.02]])
        assert outside_of(probe, [convex_hull(h.astype(float)).equations for h in model.hulls])[0] > 0.01


def test_catalogue_names_and_loads():
    catalogue = Catalogue(LARS_CLASSES, instances_per_class=3, seed=20)
    assert catalogue.classes == LARS_CLASSES == CLASSES[:5]
    assert catalogue.names("stapler") == ["stapler_0020", "stapler_0021", "stapler_0022"]
    assert catalogue.load("stapler", 1) is make_object("stapler", 21)
    assert [catalogue.load("mouse", i).instance for i in range(3)] == catalogue.names("mouse")
    assert isinstance(open_objects(classes=["can"]), Catalogue)
    assert open_objects().classes == CLASSES


def test_catalogue_refuses():
    with pytest.raises(ObjectError, match=r"'toaster'.*joypad"):
        make_object("toaster", 0)
    with pytest.raises(ObjectError, match="'toaster'"):
        Catalogue(["can", "toaster"])
    with pytest.raises(ObjectError, match="-1"):
        make_object("can", -1)
    with pytest.raises(ObjectError, match="once each"):
        Catalogue(["can", "can"])
    with pytest.raises(ObjectError, match="instances_per_class"):
        Catalogue(instances_per_class=0)
    with pytest.raises(ObjectError, match="instances 0 to 1, asked for 2"):
        Catalogue(["can"], instances_per_class=2).load("can", 2)
    with pytest.raises(ObjectError, match=r"'mug'.*can"):
        Catalogue(["can"]).names("mug")
    with pytest.raises(ObjectError, match="not a folder"):
        open_objects("/nowhere/at/all")
    assert issubclass(ObjectError, ValueError)
