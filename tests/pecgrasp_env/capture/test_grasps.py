"""Grasp labels: contacts face each other, hands are the robot's, outcomes are what physics says, sets resume."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sapien
import trimesh
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from sapien import physx

from pec.errors import DatasetError
from pec.grasps.labels import GraspLabels
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, TabletopConfig
from pecgrasp_env.capture.grasps.antipodal import antipodal_grasps
from pecgrasp_env.capture.grasps.card import write_grasps_card
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.generate import generate_grasps
from pecgrasp_env.capture.grasps.hands import CONTROL_S, Hands
from pecgrasp_env.capture.grasps.picture import OUTCOME_COLORS
from pecgrasp_env.capture.grasps.summary import summarise_grasps
from pecgrasp_env.capture.grasps.trials import OUTCOMES, TrialBench
from pecgrasp_env.common.job_share import JobShare
from pecgrasp_env.objects import CLASSES, ObjectModel, Part
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.scene.settling import add_object, task_physics

ROOT = Path(__file__).parents[3]
HELD, LOST, NOT_LIFTED, COLLIDED = range(4)
DOWN = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])


def boxes(*sizes_and_places, mass: float = 0.2) -> ObjectModel:
    """An object of boxes: sizes (3,) and centres (3,), m."""
    meshes = [trimesh.creation.box(size) for size, _ in sizes_and_places]
    for mesh, (_, place) in zip(meshes, sizes_and_places, strict=True):
        mesh.apply_translation(place)
    hulls = tuple(mesh.vertices.astype(np.float32) for mesh in meshes)
    whole = trimesh.util.concatenate(meshes)
    part = Part(whole.vertices.astype(np.float32), whole.faces.astype(np.int32), (1.0, 0.0, 0.0, 1.0))
    return ObjectModel("block", "block_0000", (part,), hulls, mass)


def block(mass: float = 0.2) -> ObjectModel:
    return boxes(((0.05, 0.06, 0.08), (0, 0, 0)), mass=mass)


def at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


# ------------------------------------------------------------------------------------------------------------ samplers


def test_antipodal_contacts_lie_on_faces_that_face_each_other_and_the_tips_above_the_table():
    T = at(0.4, 0.1, 0.04)
    grasps = antipodal_grasps(block(), T, 60, np.random.default_rng(0))
    assert len(grasps.widths) == 60
    for pose, width in zip(grasps.poses, grasps.widths, strict=True):
        assert np.allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3))
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        axis, approach = pose[:3, 0], pose[:3, 2]
        across = np.abs(axis).argmax()
        assert across != 2  # nothing is below the block
        assert width * abs(axis[across]) == pytest.approx((0.05, 0.06)[across], abs=1e-6)
        assert approach[2] < 0
        lowest = pose[2, 3] + 0.0325 * approach[2]
        assert lowest > 0.0009


def test_a_wall_is_found_only_where_a_finger_has_room_behind_it():
    """Two upright plates: a wide gap takes a finger, a narrow one none, so only both together can be held."""

    def widths(gap: float) -> np.ndarray:
        plates = [((0.004, 0.08, 0.08), (side * (gap + 0.004) / 2, 0, 0)) for side in (-1, 1)]
        grasps = antipodal_grasps(boxes(*plates), at(0, 0, 0.04), 200, np.random.default_rng(1))
        across = np.abs(grasps.poses[:, 0, 0]) > 0.9
        return grasps.widths[across]

    assert (widths(0.04) < 0.006).any()
    assert (widths(0.04) > 0.04).any()
    assert (widths(0.012) > 0.015).mean() > 0.9  # but for lines that leave past an edge of the other plate


def test_what_is_wider_than_the_hand_has_no_grasp():
    carton = boxes(((0.2, 0.2, 0.2), (0, 0, 0)))
    assert len(antipodal_grasps(carton, at(0, 0, 0.1), 5, np.random.default_rng(0)).widths) == 0


# --------------------------------------------------------------------------------------------------------------- hands


def test_hands_keep_their_pads_in_place_while_they_close_and_squeeze_as_told():
    """As the robot's own gripper: the commanded force is on each pad, and the pads stay where they are to hold."""
    force, width = 60.0, 0.06
    with task_physics() as surface:
        scene = sapien.Scene([physx.PhysxCpuSystem()])
        scene.physx_system.timestep = 0.01
        hands = Hands(scene, [2, 4])
        grasps = np.stack([at(0, 0, 0.5) @ DOWN, at(1, 0, 0.5) @ DOWN])
        thing = add_object(scene, boxes(((width, 0.05, 0.05), (0, 0, 0))), np.array([0, 0, 0.5, 1, 0, 0, 0]), surface)
        thing.disable_gravity = True
        for shape in thing.collision_shapes:
            shape.set_collision_groups([2, 2, 0, 0])
        openings, wish = np.full(2, 0.12), np.full(2, 0.12)
        hands.place(grasps, openings, np.zeros(2))
        np.testing.assert_allclose(hands.pads(), grasps[:, :3, 3], atol=1e-5)
        measured, steps = [], 40
        for number in range(steps):
            wish = np.maximum(wish - 0.15 * CONTROL_S, 0)
            hands.slide_to(np.maximum(wish, hands.opening() - 0.01), np.zeros(2))
            hands.squeeze_to(wish, np.full(2, force))
            for _ in range(5):
                scene.step()
                pressed = [c for c in scene.get_contacts() if thing.entity in [body.entity for body in c.bodies]]
                measured.append(sum(abs(sum(p.impulse for p in c.points)[0]) for c in pressed) / 0.01 / 2)
            assert np.abs(hands.pads() - grasps[:, :3, 3]).max() < 2e-3, number
    np.testing.assert_allclose(hands.opening(), [width, 0.0], atol=5e-4)
    assert np.mean(measured[-20:]) == pytest.approx(force, rel=0.2)
    assert linkage.pad_depth(0.0) - linkage.pad_depth(0.12) > 0.015  # which the slide made up for


# -------------------------------------------------------------------------------------------------------------- trials


def test_outcomes_are_what_happens():
    """A block in the middle is held, beside it is nothing, and a hand does not go through the table or the block."""
    T = at(0.5, -0.2, 0.04)
    over = T @ at(0, 0, 0.01) @ DOWN
    away, in_table, in_block = over.copy(), over.copy(), over.copy()
    away[1, 3] += 0.05
    in_table[2, 3] = 0.02
    in_block[0, 3] += 0.03
    grasps = np.stack([over, away, in_table, in_block, over])
    openings = np.array([0.09, 0.09, 0.09, 0.06, 0.14])
    outcomes = TrialBench(block(), 3).run(np.stack([T] * 5), grasps, openings, np.full(5, 60.0))
    assert outcomes.tolist() == [HELD, NOT_LIFTED, COLLIDED, COLLIDED, HELD]


def test_what_is_too_heavy_for_the_grip_is_not_lifted_and_what_nearly_is_is_lost_in_the_shake():
    """Friction holds 2 μ F: with 10 N and μ = 0.7 some 1.4 kg at rest, less while the hand is shaken."""
    T = at(0, 0, 0.04)

    def outcome(mass: float) -> int:
        trial = TrialBench(block(mass), 1).run(T[None], (T @ DOWN)[None], np.array([0.09]), np.array([10.0]))
        return int(trial[0])

    assert outcome(0.3) == HELD
    assert outcome(3.0) == NOT_LIFTED
    assert LOST in [outcome(mass) for mass in (1.0, 1.2, 1.4)]


def test_what_rolls_by_itself_has_not_been_touched_and_lies_still_until_it_is():
    """A prism of twelve faces, tipped 8° off one of them: let alone it rocks back, by more than a touch may turn it."""
    around = np.radians(15 + 30 * np.arange(12))
    corners = np.array([(x, 0.03 * np.sin(a), 0.03 * np.cos(a)) for x in (-0.05, 0.05) for a in around], np.float32)
    prism = trimesh.convex.convex_hull(corners)
    part = Part(prism.vertices.astype(np.float32), prism.faces.astype(np.int32), (1.0, 0.0, 0.0, 1.0))
    model = ObjectModel("block", "prism", (part,), (corners,), 0.2)
    T = trimesh.transformations.rotation_matrix(np.radians(8), (1, 0, 0))
    T[2, 3] = -(corners @ T[:3, :3].T)[:, 2].min()
    across = at(0, 0, 0.04) @ np.array([[0, 1.0, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
    high = across + np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0.3], [0, 0, 0, 0]])
    outcomes = TrialBench(model, 2).run(
        np.stack([T] * 4), np.stack([across, high] * 2), np.full(4, 0.1), np.full(4, 60.0)
    )
    assert outcomes.tolist() == [HELD, NOT_LIFTED] * 2


# ---------------------------------------------------------------------------------------------------------------- sets


CAPTURE = CaptureConfig(
    scenario="tabletop",
    objects=ObjectsConfig(classes=("box", "can"), instances_per_class=1),
    samples_per_instance=2,
    sensor="d435",
    tabletop=TabletopConfig(objects_per_frame=1, free_views=0.5, drops=8),
    shard_size=1,
)
SMALL = GraspsConfig(CAPTURE, grasps_per_scene=6, cells=6)


def contents(directory: Path) -> dict[str, str]:
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return generate_grasps(SMALL, tmp_path_factory.mktemp("grasps"), workers=1)


def test_labels_say_what_was_tried_on_what_was_seen(made):
    labels = GraspLabels(made.directory)
    assert (labels.classes, labels.outcomes) == (("box", "can"), OUTCOMES)
    assert made.n_grasps == made.n_new == len(labels) == labels.counts.sum()
    assert made.manifest.complete
    scenes = list(labels.scenes())
    assert len(scenes) == 4
    for scene in scenes:
        assert np.linalg.norm(scene.points.mean(axis=0) - scene.T_world_object[:3, 3]) < 0.1
        assert -0.01 < scene.points[:, 2].min() < 0.08
        assert len(scene.widths) <= SMALL.grasps_per_scene
        assert (scene.widths <= scene.openings).all()
        assert (scene.openings <= np.float32(linkage.STROKE)).all()
        assert np.linalg.norm(scene.T_world_grasp[:, :3, 3] - scene.T_world_object[:3, 3], axis=1).max() < 0.2
    summary = summarise_grasps(made)
    assert sum(summary["classes"]["box"].values()) + sum(summary["classes"]["can"].values()) == made.n_grasps


def test_shares_merge_into_what_one_run_leaves_and_damaged_shards_are_made_again(made, tmp_path):
    for share in ("0/2", "1/2"):
        generate_grasps(SMALL, tmp_path, workers=1, share=JobShare.parse(share))
    merged = generate_grasps(SMALL, tmp_path, workers=1)
    assert merged.n_new == 0
    assert contents(tmp_path) == contents(made.directory)
    shard = tmp_path / merged.manifest.shards[2].file
    shard.write_bytes(b"torn")
    again = generate_grasps(SMALL, tmp_path, workers=1)
    assert 0 < again.n_new <= SMALL.grasps_per_scene
    assert contents(tmp_path) == contents(made.directory)
    with pytest.raises(DatasetError, match="another data set"):
        generate_grasps(replace(SMALL, cells=5), tmp_path, workers=1)


def test_the_card_shows_each_class_and_outcome(made, tmp_path):
    for path in made.directory.rglob("*"):
        if path.is_file():
            (tmp_path / path.relative_to(made.directory)).parent.mkdir(exist_ok=True)
            (tmp_path / path.relative_to(made.directory)).write_bytes(path.read_bytes())
    page = write_grasps_card(tmp_path).read_text()
    assert len(OUTCOME_COLORS) == len(OUTCOMES)
    for word in (*OUTCOMES, "antipodal", "planner", "worsened", "box", "can"):
        assert word in page


def test_the_shipped_configuration_is_of_all_classes():
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        settings = compose("generate_grasps", ["out=unused", "instances_per_class=36"])
    config = GraspsConfig.from_settings(OmegaConf.to_container(settings, resolve=True))
    assert (config.grasps_per_scene, config.capture.samples_per_instance, config.capture.shard_size) == (50, 4, 4)
    assert config.capture.objects.classes == CLASSES
    assert (config.capture.sensor, config.capture.resolutions) == ("d435", ("424x240",))
    assert len(CLASSES) * 36 * 4 * 50 >= 100_000


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"grasps_per_scene": 0}, "grasps_per_scene must be at least 1, got 0"),
        ({"samplers": {"random": 1.0}}, "samplers.random does not exist; choose of antipodal, planner, worsened"),
        ({"samplers": {"planner": -1.0}}, "samplers.planner must not be negative"),
        ({"samplers": {"worsened": 1.0}}, "antipodal or planner must be above 0"),
        ({"capture": replace(CAPTURE, scenario="free")}, "objects that lie alone"),
    ],
)
def test_configurations_without_sense_are_refused(changed, message):
    with pytest.raises(CaptureError, match=message):
        replace(SMALL, **changed)
