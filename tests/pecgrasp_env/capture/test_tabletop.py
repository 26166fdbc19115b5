"""The tabletop scenario against the environment's own camera, and what is kept of a cut-out."""

import hashlib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
import trimesh

from grasping import Segmenter
from pec.data.shards import read_manifest, read_shard
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, TabletopConfig, generate, write_card
from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, Shot
from pecgrasp_env.capture.rendering.tabletop_depth import Table, background_depth, compose
from pecgrasp_env.capture.scenarios.base import Captured, Subject
from pecgrasp_env.capture.scenarios.measured_table import measured_table
from pecgrasp_env.capture.scenarios.tabletop import TabletopScenario, resting_poses
from pecgrasp_env.objects import CLASSES, LARS_CLASSES, ObjectModel, Part, make_object
from pecgrasp_env.policy.viewpoints import look_postures
from pecgrasp_env.robot import T_TOOL0_CAMERA, forward_kinematics
from pecgrasp_env.sensor import D435
from pecgrasp_env.sensor.structured_light_noise import STRUCTURED_LIGHT, StructuredLightNoise

TABLE = CaptureConfig(
    scenario="tabletop",
    objects=ObjectsConfig(classes=("can", "plug_adapter", "stapler"), instances_per_class=1),
    samples_per_instance=4,
    shard_size=6,
    tabletop=TabletopConfig(drops=6),
)


def block(x: float, y: float, z: float, name: str = "block_0000") -> ObjectModel:
    mesh = trimesh.creation.box((x, y, z))
    part = Part(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), (1.0, 0.0, 0.0, 1.0))
    return ObjectModel("block", name, (part,), (part.vertices,), 0.1)


def contents(directory: Path) -> dict[str, str]:
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def pictured(renderer: DepthRenderer, poses: list[np.ndarray], T_base_camera: np.ndarray) -> Table:
    """The objects that the renderer shows, at T_camera_object each, on the table."""
    camera = D435["424x240"]
    shots = [Shot(i, pose, camera, renderer.extent(i, pose, camera)) for i, pose in enumerate(poses)]
    return compose(shots, renderer.render_all(shots), T_base_camera, camera)


def test_a_frame_is_what_the_environments_wrist_camera_sees():
    env = gym.make(
        "SelectiveGrasp-v1",
        obs_mode="depth+segmentation",
        control_mode="pd_joint_pos",
        classes=LARS_CLASSES,
        n_objects=4,
        sim_backend="physx_cpu",
        render_backend="cpu",
    )
    env.reset(seed=3)
    task = env.unwrapped
    renderer = DepthRenderer(0.45)
    renderer.show(task.models[0])
    for posture in look_postures():
        q = task.agent.robot.get_qpos().clone()
        q[0, :6] = torch.tensor(posture)
        task.agent.robot.set_qpos(q)
        pictures = task.get_obs()["sensor_data"]["wrist_camera"]
        seen = pictures["depth"][0, ..., 0].numpy()
        segmentation = pictures["segmentation"][0, ..., 0].numpy()
        T = forward_kinematics(posture) @ T_TOOL0_CAMERA
        poses = [
            np.linalg.inv(T) @ actor.pose.to_transformation_matrix()[0].numpy().astype(float) for actor in task.objects
        ]
        table = pictured(renderer, poses, T)
        # Silhouettes may fall to the other side by a pixel; that the picture shows a floor beside the table, too.
        assert np.mean(np.abs(table.depth - seen) < 2e-4) > 0.998
        for i, actor in enumerate(task.objects):
            theirs, ours = segmentation == int(actor.per_scene_id[0]), table.owner == i + 1
            assert (theirs & ours).sum() > 0.97 * max(theirs.sum(), ours.sum()) > 100
    env.close()


def test_the_background_is_the_table_and_beside_it_the_floor():
    camera = D435["424x240"]
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T[:3, 3] = 0.8, 0.0, 0.5  # straight down, over the table's far edge
    depth = background_depth(T, camera)
    assert set(np.unique(depth).tolist()) == {0.5, 1.25}
    at = 0.8 + (np.arange(424) + 0.5 - camera.cx) / camera.fx * 0.5
    assert np.array_equal(depth[0] == 0.5, at < 0.95)
    T[:3, :3] = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # at the horizon
    assert (background_depth(T, camera)[:120] == 0).all()


@pytest.mark.parametrize(("class_name", "seed"), [("stapler", 0), ("plug_adapter", 1), ("can", 2)])
def test_objects_rest_on_the_table(class_name, seed):
    model = make_object(class_name, seed)
    poses = resting_poses(model, 24, 0)
    assert len(poses) >= 20
    corners = np.concatenate(model.hulls)
    for pose in poses:
        rotation = trimesh.transformations.quaternion_matrix(pose[3:])[:3, :3]
        assert abs((corners @ rotation.T + pose[:3])[:, 2].min()) < 1e-3
    assert np.array_equal(poses, resting_poses(model, 24, 0))
    assert not np.array_equal(poses, resting_poses(model, 24, 1))


def test_a_block_rests_on_its_faces_and_mostly_on_the_large_ones():
    poses = resting_poses(block(0.10, 0.06, 0.03), 64, 3)
    # the vertical in the object's frame
    up = np.array([trimesh.transformations.quaternion_matrix(pose[3:])[2, :3] for pose in poses])
    axis = np.abs(up).argmax(axis=1)
    assert np.abs(up).max(axis=1) == pytest.approx(np.ones(len(up)), abs=0.01)
    assert np.bincount(axis, minlength=3)[2] > len(up) / 2


def test_clouds_are_what_the_robots_segmenter_cuts_out_labelled_by_the_renderer(monkeypatch):
    scenes = []

    class Watched(Segmenter):
        def segment(self, cloud, **kwargs):
            scenes.append(super().segment(cloud, **kwargs))
            return scenes[-1]

    monkeypatch.setattr("pecgrasp_env.capture.scenarios.tabletop.Segmenter", Watched)
    models = [make_object("can", 0), block(0.12, 0.05, 0.03), make_object("stapler", 2)]
    made = TabletopScenario(TABLE).capture([Subject(model, i, 7 + i) for i, model in enumerate(models)], 0, 5)
    assert [sample.class_index for sample in made.samples] == [0] * 5 + [1] * 5 + [2] * 5
    assert [sample.instance_index for sample in made.samples] == [7] * 5 + [8] * 5 + [9] * 5
    cut = {cloud.tobytes() for scene in scenes for cloud in scene.objects}
    for sample in made.samples:
        assert sample.points.tobytes() in cut
        T = sample.T_camera_object
        local = (sample.points - T[:3, 3]) @ T[:3, :3]
        vertices = models[sample.class_index].visual_mesh().vertices
        # With the ideal sensor only the label could be wrong: the points lie within the object that it says.
        assert np.mean(np.all((local > vertices.min(0) - 2e-3) & (local < vertices.max(0) + 2e-3), axis=1)) > 0.99
        assert 0 <= sample.camera < 4
        assert sample.occlusion <= TABLE.max_occlusion
        assert sample.purity >= TABLE.tabletop.min_purity
    assert len({sample.camera for sample in made.samples}) > 1
    assert len({sample.seed for sample in made.samples}) <= len(scenes)  # a frame gives several samples


def capture(config: CaptureConfig, models: list[ObjectModel], count: int) -> Captured:
    return TabletopScenario(config).capture([Subject(model, i, i) for i, model in enumerate(models)], 0, count)


def laid_close(**changes) -> CaptureConfig:
    """Nothing keeps outlines apart, so some objects touch or hide others."""
    min_purity = changes.pop("min_purity", TABLE.tabletop.min_purity)
    return replace(TABLE, tabletop=replace(TABLE.tabletop, clearance=0.0, min_purity=min_purity), **changes)


def test_mixed_cut_outs_are_dropped_and_counted_or_kept_and_marked():
    """Blocks on a full table, of which the segmenter takes some that touch for one object."""
    blocks = [block(0.10, 0.10, 0.05, f"block_{i}") for i in range(6)]
    made = capture(laid_close(), blocks, 10)
    assert made.rejected["mixed"] > 0
    assert min(sample.purity for sample in made.samples) >= TABLE.tabletop.min_purity
    made = capture(laid_close(min_purity=0.0), blocks, 10)
    assert "mixed" not in made.rejected
    assert min(sample.purity for sample in made.samples) < 0.6


def test_what_others_hide_is_measured_and_rejected():
    tall, low = block(0.05, 0.14, 0.20, "tall"), block(0.05, 0.06, 0.03, "low")
    renderer = DepthRenderer(0.45)
    renderer.show([tall, low])
    eye = np.eye(4)
    eye[:3, :3] = np.array([[0, -0.6, 0.8], [-1.0, 0, 0], [0, -0.8, -0.6]])  # looks along +x and down
    eye[:3, 3] = -0.1, 0.0, 0.5

    def hidden(gap: float) -> np.ndarray:
        poses = []
        for x, z in ((0.4, 0.1), (0.45 + gap, 0.015)):
            T = np.eye(4)
            T[:3, 3] = x, 0.0, z
            poses.append(np.linalg.inv(eye) @ T)
        return pictured(renderer, poses, eye).occlusion

    assert hidden(0.02) == pytest.approx([0, 1], abs=0.05)
    assert hidden(0.5)[1] == 0
    shares = [hidden(gap)[1] for gap in np.linspace(0.02, 0.3, 12)]
    assert shares == sorted(shares, reverse=True)
    assert any(0.2 < share < 0.8 for share in shares)


def test_an_object_that_others_hide_too_much_gives_no_sample_of_that_frame():
    models = [block(0.05, 0.14, 0.20, "tall"), block(0.05, 0.06, 0.03, "low"), block(0.05, 0.06, 0.03, "lower")]
    made = capture(laid_close(max_occlusion=0.0), models, 15)
    assert made.rejected["hidden"] > 0
    assert {sample.occlusion for sample in made.samples} == {0.0}
    made = capture(laid_close(max_occlusion=1.0), models, 15)
    assert "hidden" not in made.rejected
    assert max(sample.occlusion for sample in made.samples) > 0


def test_an_object_that_the_segmenter_never_finds_is_given_up_with_the_reasons():
    flat = block(0.08, 0.06, 0.001, "card")
    made = capture(TABLE, [flat, make_object("can", 0)], 2)
    assert [sample.class_index for sample in made.samples] == [1, 1]
    assert list(made.given_up) == ["block/card"]
    assert "not found" in made.given_up["block/card"]
    assert "2 mm" in made.given_up["block/card"]


def test_distractors_give_no_sample_and_change_what_is_seen():
    can = make_object("can", 0)
    made = capture(replace(TABLE, tabletop=replace(TABLE.tabletop, distractors=2)), [can], 3)
    assert [sample.class_index for sample in made.samples] == [0, 0, 0]
    assert not np.array_equal(made.samples[0].points, capture(TABLE, [can], 1).samples[0].points)


def test_distractors_must_be_of_classes_that_the_set_does_not_label():
    config = replace(TABLE, objects=ObjectsConfig(classes=CLASSES), tabletop=replace(TABLE.tabletop, distractors=1))
    with pytest.raises(CaptureError, match=r"distractors: the data set labels all classes"):
        capture(config, [make_object("can", 0)], 1)


def test_a_camera_on_a_stand_sees_the_table_from_near_and_far():
    model = block(0.10, 0.06, 0.04)
    config = replace(laid_close(), samples_per_instance=24)
    config = replace(config, tabletop=replace(config.tabletop, free_views=1.0, clearance=0.03))
    captured = capture(config, [model], 24)
    assert len(captured.samples) == 24
    robots = len(look_postures())
    assert {sample.camera for sample in captured.samples} == {robots}
    assert config.cameras[robots]["name"] == "424x240, on a stand"
    poses = np.array([sample.T_camera_object for sample in captured.samples])
    distance = np.linalg.norm(poses[:, :3, 3], axis=1)
    assert distance.min() < 0.7
    assert distance.max() > 1.0
    for sample in captured.samples:
        inside = (sample.points - sample.T_camera_object[:3, 3]) @ sample.T_camera_object[:3, :3]
        assert (np.abs(inside) <= [0.055, 0.035, 0.025]).all()


def test_the_set_has_the_same_bytes_from_two_workers_and_d435(tmp_path):
    config = replace(TABLE, sensor="d435")
    one = generate(config, tmp_path / "one", workers=1).directory
    two = generate(config, tmp_path / "two", workers=2).directory
    assert contents(one) == contents(two)
    manifest = read_manifest(one)
    assert manifest.config["scenario"] == "tabletop"
    assert "max_depth" not in manifest.config
    assert [camera["name"] for camera in manifest.cameras] == [f"424x240, the policy's view {k}" for k in (1, 2, 3, 4)]
    counts = Counter()
    for record in manifest.shards:
        counts.update(read_shard(one / record.file, record).instance_index.tolist())
    assert counts == {0: 4, 1: 4, 2: 4}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objects_per_frame": 0}, r"objects_per_frame must lie in 1 … 15, got 0"),
        ({"distractors": -1}, "distractors"),
        ({"min_purity": 1.2}, "min_purity"),
        ({"joint_noise": 0.5}, "joint_noise"),
        ({"free_views": 1.5}, r"free_views must lie in 0 … 1, got 1.5"),
        ({"drops": 0}, "drops"),
    ],
)
def test_settings_that_make_no_sense_are_named(change, message):
    with pytest.raises(CaptureError, match=rf"tabletop\.{message}"):
        TabletopConfig(**change)


def wall_with_squares(count: int, size: tuple[int, int] = (480, 640)) -> Table:
    """Squares, 120 pixels wide, one an object, 0.2 m before a wall."""
    depth, owner = np.full(size, 1.0, np.float32), np.zeros(size, np.int16)
    for i in range(count):
        here = (slice(40 + 140 * (i // 4), 160 + 140 * (i // 4)), slice(30 + 150 * (i % 4), 150 + 150 * (i % 4)))
        depth[here], owner[here] = 0.8, i + 1
    return Table(depth, owner, np.zeros(count))


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["ideal", "d435", "structured_light"])
def test_with_losses_one_object_in_six_keeps_less_than_nine_tenths(sensor):
    light = sensor == "structured_light"
    noise = StructuredLightNoise() if light else TABLE.noise
    config = replace(TABLE, sensor=sensor, noise=noise, resolutions=("640x480",))
    camera = STRUCTURED_LIGHT["640x480"] if light else D435["640x480"]
    exact = wall_with_squares(12)
    kept: dict[bool, list[float]] = {}
    for losses in (False, True):
        config = replace(config, tabletop=replace(config.tabletop, losses=losses))
        tables = [measured_table(config, exact, camera, np.random.default_rng(seed)) for seed in range(8)]
        kept[losses] = [float((table.depth[table.owner == i + 1] > 0).mean()) for table in tables for i in range(12)]
        again = measured_table(config, exact, camera, np.random.default_rng(0))
        np.testing.assert_array_equal(again.depth, tables[0].depth)
    usual = min(kept[False])
    assert 0.06 < np.mean(np.array(kept[True]) < usual - 0.1) < 0.35  # 0.16 lose a fifth or more
    assert np.median(kept[True]) > usual - 0.05


def test_where_structured_light_moves_a_border_the_owner_goes_along():
    config = replace(TABLE, sensor="structured_light", noise=StructuredLightNoise(), resolutions=("640x480",))
    exact = wall_with_squares(12)
    table = measured_table(config, exact, STRUCTURED_LIGHT["640x480"], np.random.default_rng(1))
    seen = table.depth > 0
    assert ((table.depth < 0.9) == (table.owner > 0))[seen].all()
    assert (table.owner != exact.owner)[seen].any()


def test_an_ideal_sensor_keeps_the_table_whatever_noise_is_named():
    config = replace(TABLE, sensor="ideal", noise=StructuredLightNoise())
    exact = wall_with_squares(12)
    table = measured_table(config, exact, D435["640x480"], np.random.default_rng(1))
    np.testing.assert_array_equal(table.depth, exact.depth)
    np.testing.assert_array_equal(table.owner, exact.owner)


@pytest.mark.slow
def test_clouds_of_a_camera_on_a_stand_with_structured_light(tmp_path):
    light = replace(
        TABLE,
        sensor="structured_light",
        resolutions=("640x480",),
        noise=StructuredLightNoise(),
        tabletop=TabletopConfig(drops=6, free_views=1.0, losses=True),
    )
    generate(light, tmp_path, workers=1)
    manifest = read_manifest(tmp_path)
    assert manifest.config["sensor"] == "structured_light"
    assert manifest.config["tabletop"]["losses"] is True
    shard = read_shard(tmp_path / manifest.shards[0].file)
    depth = shard.points[:, 2]
    assert depth.min() > 0.35
    disparity = 525.0 * 0.075 / depth
    # Whole eighths of a pixel, but for the millimetres to which depth is rounded.
    steps = np.abs(disparity * 8 - np.rint(disparity * 8))
    assert np.median(steps) < 8 * np.median(disparity / depth) * 0.0005
    card = write_card(tmp_path).read_text()
    assert "structured-light" in card
    assert "a camera on a stand" in card
