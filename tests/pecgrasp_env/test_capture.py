"""Captured clouds against the geometry they were rendered from, and the promises of the data set on disk."""

import hashlib
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pec.errors import DatasetError
from pec.shards import CloudSample, read_manifest, read_shard
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, generate, summarise
from pecgrasp_env.capture.free import FreeScenario, random_pose
from pecgrasp_env.capture.samples import Subject, sample_seed
from pecgrasp_env.capture.studio import DepthStudio
from pecgrasp_env.objects import CLASSES, LARS_CLASSES, ObjectError, ObjectModel, Part, make_object
from pecgrasp_env.sensor import D435, D435Noise, SensorError

ROOT = Path(__file__).parents[2]
SMALL = CaptureConfig(
    objects=ObjectsConfig(classes=("can", "plug_adapter"), instances_per_class=2),
    samples_per_instance=12,
    shard_size=5,
    resolutions=("424x240",),
    seed=7,
)


def block(x: float, y: float, z: float) -> ObjectModel:
    mesh = trimesh.creation.box((x, y, z))
    part = Part(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), (1.0, 0.0, 0.0, 1.0))
    return ObjectModel("block", "block_0000", (part,), (part.vertices,), 0.1)


def captured(scenario, model: ObjectModel, count: int, first: int = 0) -> list[CloudSample]:
    made = scenario.capture([Subject(model, 0, 0)], first, count)
    assert not made.given_up
    assert len(made.samples) == count
    return made.samples


def in_object_frame(sample) -> np.ndarray:
    T = sample.T_camera_object.astype(float)
    return (sample.points - T[:3, 3]) @ T[:3, :3]


def contents(directory: Path) -> dict[str, str]:
    """Hash of every file: equal exactly where the bytes are, and a difference is shown in a line."""
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Path:
    """The small data set, made in one go by one process."""
    return generate(SMALL, tmp_path_factory.mktemp("reference") / "data", workers=1).directory


# What is captured


def test_cloud_of_a_block_lies_on_the_block():
    half = np.array([0.06, 0.04, 0.025])
    scenario = FreeScenario(CaptureConfig(resolutions=("848x480",)))
    for sample in captured(scenario, block(*(2 * half)), 40):
        outside = np.abs(in_object_frame(sample)) - half
        distance = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)
        assert np.abs(distance).max() < 1e-4


def test_cloud_is_what_rays_through_the_pixels_hit_first():
    model = make_object("stapler", 3)
    config = CaptureConfig(resolutions=("424x240",), max_depth=0.6, min_points=300)
    scenario = FreeScenario(config)
    mesh = model.visual_mesh()
    (sample,) = captured(scenario, model, 1)
    T = sample.T_camera_object.astype(float)
    triangles = mesh.vertices[mesh.faces] @ T[:3, :3].T + T[:3, 3]
    (camera,) = config.intrinsics
    projected = triangles[..., :2] / triangles[..., 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    low, high = np.floor(projected.min((0, 1))).astype(int), np.ceil(projected.max((0, 1))).astype(int)
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    rays = np.stack(
        [(columns + 0.5 - camera.cx) / camera.fx, (rows + 0.5 - camera.cy) / camera.fy, np.ones(rows.shape)], -1
    )
    depth = first_hits(rays.reshape(-1, 3), triangles).reshape(rows.shape)
    seen = np.zeros(rows.shape)
    pixels = sample.points[:, :2] / sample.points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    at = np.floor(pixels).astype(int) - low
    seen[at[:, 1], at[:, 0]] = sample.points[:, 2]
    both = (seen > 0) & np.isfinite(depth)
    # The rasteriser snaps corners to 1/256 pixel: a few pixels on silhouettes and creases fall to the other side.
    assert both.sum() > 0.99 * max((seen > 0).sum(), np.isfinite(depth).sum())
    assert np.quantile(np.abs(seen - depth)[both], 0.99) < 1e-4


def first_hits(rays: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Depth (N,) at which rays (N, 3) with z = 1 from the origin first meet triangles (F, 3, 3), or inf."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    q = np.cross(-a, ab)
    depth = np.full(len(rays), np.inf)
    for index, ray in enumerate(rays):
        p = np.cross(ray, ac)
        determinant = np.einsum("ij,ij->i", ab, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", -a, p) / determinant
            v = q @ ray / determinant
            t = np.einsum("ij,ij->i", ac, q) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        depth[index] = t[hit].min(initial=np.inf)
    return depth


def test_a_window_shows_what_the_full_frame_shows():
    studio, camera = DepthStudio(2.0), D435["424x240"]
    studio.show([make_object("stapler", 1)])
    T = np.eye(4)
    T[:3, 3] = 0.13, -0.05, 0.55
    frame = studio.photograph(0, T, camera, studio.extent(0, T, camera))
    part, window = frame.depth, frame.intrinsics
    assert window.width < 200
    whole = studio.draw(camera).depth
    assert whole.shape == (240, 424)
    left, top = window.first_column, int(camera.cy - window.cy)
    assert (part > 0).sum() == (whole > 0).sum() > 500
    assert part == pytest.approx(whole[top : top + window.height, left : left + window.width], abs=2e-5)


def test_every_object_is_wholly_in_view_beyond_the_minimum_depth(reference):
    manifest = read_manifest(reference)
    for record in manifest.shards:
        shard = read_shard(reference / record.file, record)
        assert np.all(np.diff(shard.offsets) >= SMALL.min_points)
        depth = shard.points[:, 2]
        assert depth.min() >= SMALL.intrinsics[0].min_depth
        assert shard.T_camera_object[:, 2, 3].max() <= 2.0


def test_labels_poses_and_seeds_belong_to_the_clouds(reference):
    manifest = read_manifest(reference)
    assert manifest.complete
    assert manifest.classes == ["can", "plug_adapter"]
    names = [instance["name"] for instance in manifest.instances]
    assert names == ["can_0000", "can_0001", "plug_adapter_0000", "plug_adapter_0001"]
    counts: Counter[int] = Counter()
    for record in manifest.shards:
        shard = read_shard(reference / record.file, record)
        for i in range(len(shard)):
            instance = int(shard.instance_index[i])
            assert manifest.classes[shard.class_index[i]] == manifest.instances[instance]["class"]
            vertices = make_object(*split_name(names[instance])).visual_mesh().vertices
            T = shard.T_camera_object[i].astype(float)
            cloud = (shard.cloud(i) - T[:3, 3]) @ T[:3, :3]
            assert np.all(cloud > vertices.min(0) - 1e-4)
            assert np.all(cloud < vertices.max(0) + 1e-4)
            seed = sample_seed(7, manifest.instances[instance]["class"], names[instance], counts[instance])
            assert shard.seed[i] == seed
            counts[instance] += 1
    assert counts == {0: 12, 1: 12, 2: 12, 3: 12}


def split_name(name: str) -> tuple[str, int]:
    class_name, _, number = name.rpartition("_")
    return class_name, int(number)


def test_rotations_are_uniform_and_positions_uniform_in_the_frustum():
    camera = D435["424x240"]
    rng = np.random.default_rng(0)
    poses = np.array([random_pose(camera, 2.0, rng) for _ in range(4000)])
    rotations = poses[:, :3, :3]
    assert np.linalg.det(rotations) == pytest.approx(np.ones(4000))
    # Of a uniform rotation every entry is uniform on [-1, 1] (Archimedes): mean 0, variance 1/3.
    assert np.abs(rotations.mean(0)).max() < 0.04
    assert rotations.var(0) == pytest.approx(np.full((3, 3), 1 / 3), abs=0.02)
    x, y, z = poses[:, :3, 3].T
    near = camera.min_depth
    share = np.mean(z < 1.0)
    assert share == pytest.approx((1 - near**3) / (8 - near**3), abs=0.02)  # an eighth of the volume is within 1 m
    for along, size, focal in ((x, camera.width, camera.fx), (y, camera.height, camera.fy)):
        place = along / z * focal / size
        assert np.abs(place).max() <= 0.5
        assert place.var() == pytest.approx(1 / 12, abs=0.005)


def test_d435_clouds_are_noisy_as_the_depth_says():
    noise = D435Noise(edge_hole=0, edge_flying=0, patch_density=0, grazing_start=1.5, grazing_end=1.57)
    config = CaptureConfig(sensor="d435", noise=noise, resolutions=("848x480",), min_points=100)
    scenario = FreeScenario(config)
    half = np.array([0.1, 0.1, 0.1])
    (camera,), ratios = config.intrinsics, []
    for sample in captured(scenario, block(*(2 * half)), 60):
        local, T = in_object_frame(sample), sample.T_camera_object
        # Along the ray, a face whose normal makes the angle a with it is error · cos(a) away from the measured point.
        axis = np.argmax(np.abs(local), axis=1)
        face = np.sign(np.take_along_axis(local, axis[:, None], 1)[:, 0]) * 0.1
        normal = T[:3, :3].T[axis].astype(float)
        rays = sample.points / sample.points[:, 2:]
        off = np.take_along_axis(local, axis[:, None], 1)[:, 0] - face
        inner = np.sort(np.abs(local), axis=1)[:, 1] < 0.08  # away from edges, where the face is not in doubt
        along = np.einsum("ij,ij->i", normal, rays)
        error = off[inner] / along[inner]
        z = sample.points[inner, 2]
        ratios.append(error / (z**2 * noise.subpixel_error / (camera.fx * 0.05)))
    assert np.median(np.abs(np.concatenate(ratios))) == pytest.approx(0.674, rel=0.15)  # of a normal distribution


def test_several_cameras_take_turns_and_are_listed(tmp_path):
    config = replace(SMALL, resolutions=("424x240", "848x480"))
    manifest = read_manifest(generate(config, tmp_path / "data", workers=1).directory)
    assert [camera["name"] for camera in manifest.cameras] == ["424x240", "848x480"]
    assert manifest.cameras[1]["width"] == 848
    shards = [read_shard(tmp_path / "data" / record.file, record) for record in manifest.shards]
    taken = np.concatenate([shard.camera for shard in shards])
    assert 10 < taken.sum() < 38  # of 48
    for shard in shards:
        for i in range(len(shard)):
            camera = D435[manifest.cameras[shard.camera[i]]["name"]]
            points = shard.cloud(i).astype(float)
            pixels = points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
            assert np.abs(pixels % 1 - 0.5).max() < 0.01  # each point lies on the ray of a pixel of its own camera


# The data set on disk


def test_two_workers_write_the_same_bytes_as_one(reference, tmp_path):
    made = generate(SMALL, tmp_path / "two", workers=2)
    assert made.n_new == made.n_samples == 48
    assert contents(made.directory) == contents(reference)


class Stop(Exception):
    pass


def test_an_interrupted_run_goes_on_to_the_same_bytes(reference, tmp_path):
    directory = tmp_path / "data"
    seen = []

    def stop_after(done, total):
        seen.append(done)
        assert total == 48
        if len(seen) > 4:
            raise Stop

    with pytest.raises(Stop):
        generate(SMALL, directory, workers=1, progress=stop_after)
    partial = read_manifest(directory)
    assert not partial.complete
    assert sum(record.n_samples for record in partial.shards) == seen[-1] < 48
    resumed = generate(SMALL, directory, workers=1)
    assert resumed.n_new == 48 - seen[-1]
    assert contents(directory) == contents(reference)
    again = generate(SMALL, directory, workers=1)
    assert (again.n_new, again.n_samples) == (0, 48)
    assert again.rejected == resumed.rejected


def test_a_damaged_or_missing_shard_is_made_again(reference, tmp_path):
    made = generate(SMALL, tmp_path / "data", workers=1).directory
    (made / "shards/00002.safetensors").write_bytes(b"damaged")
    (made / "shards/00004.safetensors").unlink()
    repaired = generate(SMALL, made, workers=1)
    assert repaired.n_new == 10 - 3  # shards of 5, 5 and 2 samples an instance: 00002 has 2, 00004 has 5
    assert contents(made) == contents(reference)


def test_other_classes_and_more_samples_change_no_sample(reference, tmp_path):
    config = CaptureConfig(
        objects=ObjectsConfig(classes=("plug_adapter",), instances_per_class=1),
        samples_per_instance=5,
        resolutions=("424x240",),
        seed=7,
    )
    (record,) = read_manifest(generate(config, tmp_path / "alone", workers=1).directory).shards
    alone = read_shard(tmp_path / "alone" / record.file)
    among = read_shard(reference / "shards/00006.safetensors")
    assert np.array_equal(alone.points, among.points)
    assert np.array_equal(alone.seed, among.seed)


def test_another_configuration_in_the_same_folder_is_refused(reference):
    for change, message in (
        ({"max_depth": 1.5}, "config.max_depth is 2.0 there, 1.5 here"),
        ({"seed": 8}, "config.seed is 7 there, 8 here"),
        ({"objects": ObjectsConfig(classes=("can",), instances_per_class=2)}, "config.objects.classes"),
    ):
        with pytest.raises(DatasetError, match=message):
            generate(CaptureConfig(**{**vars(SMALL), **change}), reference, workers=1)


def test_summary_counts_what_is_there(reference):
    summary = summarise(generate(SMALL, reference, workers=1))
    assert [(row["class"], row["instances"], row["clouds"]) for row in summary["classes"]] == [
        ("can", 2, 24),
        ("plug_adapter", 2, 24),
    ]
    assert summary["clouds"] == 48
    assert summary["new_clouds"] == 0
    low, median, high = summary["classes"][0]["points"]
    assert SMALL.min_points <= low <= median <= high


# Bad input


def test_the_default_is_the_lars_set():
    config = CaptureConfig()
    assert config.samples_per_instance == 1000
    assert config.objects == ObjectsConfig()
    assert len(LARS_CLASSES) == 5


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["dataset=lars"],
        ["objects=catalogue"],
        ["sensor=d435"],
        ["scenario=tabletop", "sensor=d435"],
        ["dataset=ycb"],
    ],
)
def test_the_configurations_that_are_shipped_say_what_the_code_defaults_to(overrides):
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        settings = compose("generate", ["out=unused", *overrides])
    config = CaptureConfig.from_settings(OmegaConf.to_container(settings, resolve=True))
    classes = CLASSES if "objects=catalogue" in overrides else None
    source = "ycb" if "dataset=ycb" in overrides else "catalogue"
    objects = ObjectsConfig(source=source, classes=classes, instances_per_class=10 if classes else None)
    scenario = "tabletop" if "scenario=tabletop" in overrides else "free"
    sensor = "d435" if "sensor=d435" in overrides else "ideal"
    assert config == CaptureConfig(objects=objects, scenario=scenario, sensor=sensor, resolutions=("848x480",))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"samples_per_instance": 0}, CaptureError, "samples_per_instance must be at least 1, got 0"),
        ({"min_points": 0}, CaptureError, "min_points"),
        ({"max_depth": 0.1}, CaptureError, "max_depth 0.1 m must exceed"),
        ({"seed": -1}, CaptureError, "seed"),
        ({"resolutions": ("800x600",)}, SensorError, "800x600"),
        ({"resolutions": ("424x240", "424x240")}, CaptureError, "none twice"),
        ({"max_occlusion": 1.5}, CaptureError, "max_occlusion"),
        ({"sensor": "lidar"}, SensorError, "lidar"),
        ({"scenario": "shelf"}, CaptureError, "shelf.*free, tabletop"),
    ],
)
def test_a_configuration_that_makes_no_sense_is_named(change, error, message):
    with pytest.raises(error, match=message):
        CaptureConfig(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": ()}, "classes"),
        ({"classes": ("a", "a")}, "classes"),
        ({"instances_per_class": 0}, "instances"),
        ({"scale": 0.0}, "scale"),
    ],
)
def test_objects_that_make_no_sense_are_named(change, message):
    with pytest.raises(CaptureError, match=message):
        ObjectsConfig(**change)


def test_a_folder_of_meshes_becomes_a_data_set(tmp_path):
    for class_name, size in (("brick", 0.1), ("plank", 0.2)):
        (tmp_path / "meshes" / class_name).mkdir(parents=True)
        mesh = trimesh.creation.box((1000 * size, 40, 30))
        mesh.export(tmp_path / "meshes" / class_name / "1.stl")  # one name in both classes, and millimetres
    objects = ObjectsConfig(path=str(tmp_path / "meshes"), scale=0.001)
    config = CaptureConfig(objects=objects, samples_per_instance=4, resolutions=("424x240",))
    manifest = read_manifest(generate(config, tmp_path / "data", workers=1).directory)
    assert [(i["class"], i["name"], i["extents_m"]) for i in manifest.instances] == [
        ("brick", "1", [0.1, 0.04, 0.03]),
        ("plank", "1", [0.2, 0.04, 0.03]),
    ]
    assert [record.n_samples for record in manifest.shards] == [8]


def test_an_unknown_class_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(ObjectError, match="teapot"):
        generate(CaptureConfig(objects=ObjectsConfig(classes=("teapot",))), tmp_path / "data", workers=1)
    assert not (tmp_path / "data").exists()


def test_an_object_in_millimetres_is_told_from_one_in_metres():
    made = FreeScenario(CaptureConfig()).capture([Subject(block(120, 80, 50), 0, 0)], 0, 1)
    assert re.search(r"block_0000 is 120 m long.*objects\.scale", made.given_up["block/block_0000"])


def test_an_object_that_never_has_enough_points_is_given_up_with_the_reasons():
    scenario = FreeScenario(CaptureConfig(min_points=300_000, resolutions=("424x240",)))
    made = scenario.capture([Subject(block(0.1, 0.1, 0.1), 0, 0)], 0, 1)
    assert not made.samples
    assert re.search(r"none of 2000 poses gave a cloud .*too few points: \d+", made.given_up["block/block_0000"])


def test_workers_and_a_file_in_the_way_are_named(tmp_path):
    with pytest.raises(CaptureError, match="workers must be at least 1, got 0"):
        generate(SMALL, tmp_path, workers=0)
    (tmp_path / "data").write_text("a file, not a folder")
    with pytest.raises(CaptureError, match="cannot write the data set in"):
        generate(SMALL, tmp_path / "data", workers=1)


def test_the_script_names_the_class_that_does_not_exist(tmp_path):
    done = subprocess.run(
        [sys.executable, "scripts/generate_dataset.py", "objects.classes=[teapot]", f"out={tmp_path / 'data'}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env={**os.environ, "HYDRA_FULL_ERROR": "0"},
    )
    assert done.returncode == 1
    assert "teapot" in done.stderr
    assert "Traceback" not in done.stderr
