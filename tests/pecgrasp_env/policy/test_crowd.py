"""Among many objects: what lies on what, what two views say of one heap, where something can be put down."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from mani_skill.utils.structs.pose import Pose

from grasping import ROBOTIQ_2F_140, CurvaturePlanner
from grasping.segmentation.scene import Cut
from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.envs.task_state import air_below
from pecgrasp_env.motion.grasp_approach import plan_approach
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.policy.crowd import borne_by, floor_below, lying_on, uppermost_on, without_rim
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.policy.perception import View
from pecgrasp_env.policy.pick_planner import PickPlanner
from pecgrasp_env.policy.put_down import free_places, plan_put_down
from pecgrasp_env.policy.seen_objects import UNKNOWN, SeenObject, merge, most_trusted
from pecgrasp_env.robot.kinematics import HOME, T_TOOL0_CAMERA, forward_kinematics

TABLE = np.array([0.0, 0.0, 1.0, 0.0])


def patch(x, y, z, pitch=0.002):
    """A level surface over x = (low, high), y likewise, at height z, m."""
    return np.stack(np.meshgrid(np.arange(*x, pitch), np.arange(*y, pitch), [z], indexing="ij"), axis=-1).reshape(-1, 3)


def seen(points, certainty=1.0, **evidence):
    return SeenObject(points, False, [evidence] if evidence else [], np.array([[0.5, 0, 0.55]]), certainty=certainty)


LOWER_LEFT = patch((0.40, 0.44), (0.00, 0.06), 0.03)
LOWER_RIGHT = patch((0.48, 0.52), (0.00, 0.06), 0.03)
LOWER = np.concatenate([LOWER_LEFT, LOWER_RIGHT])  # its middle is hidden
UPPER = patch((0.44, 0.48), (-0.01, 0.07), 0.06)
TOP = patch((0.44, 0.47), (0.05, 0.09), 0.09)
AWAY = LOWER + np.array([0.0, 0.2, 0.0])
BESIDE = patch((0.40, 0.50), (0.08, 0.12), 0.06)


def test_an_object_lies_on_what_it_hides_the_middle_of_and_not_on_what_it_stands_beside():
    objects = [seen(LOWER), seen(UPPER), seen(BESIDE)]
    upon = lying_on(objects, 0)
    assert list(upon) == [1]
    assert upon[1] == pytest.approx(1 / 3, abs=0.05)
    assert lying_on(objects, 1) == {}
    assert lying_on([seen(LOWER), seen(UPPER - [0, 0, 0.03])], 0) == {}  # between its parts, and no higher


def test_what_is_seen_to_stand_on_the_table_is_not_borne_though_it_rises_over_the_outline():
    column = np.concatenate([patch((0.44, 0.48), (0.02, 0.04), z) for z in np.arange(0.002, 0.06, 0.004)])
    for plane, rise in ((None, 0.0), (np.array([0.0, 0.0, 1.0, -0.01]), 0.01)):
        objects = [seen(each + np.array([0, 0, rise])) for each in (LOWER, column, UPPER)]
        assert set(lying_on(objects, 0)) == {1, 2}
        assert borne_by(objects, 0, plane) == [2]
    assert borne_by([seen(LOWER), seen(BESIDE)], 0, None) == []


def test_what_nothing_lies_on_is_taken_first():
    assert uppermost_on([seen(LOWER), seen(UPPER), seen(TOP)], 0) == [2]
    far = patch((0.44, 0.48), (0.00, 0.025), 0.05)
    near = patch((0.44, 0.48), (0.03, 0.06), 0.06)
    assert uppermost_on([seen(LOWER), seen(far), seen(near)], 0) == [2, 1]  # the higher one first
    assert uppermost_on([seen(LOWER), seen(BESIDE)], 0) == []


def test_what_stands_on_the_floor_or_covers_next_to_nothing_is_not_taken_off():
    column = np.concatenate([patch((0.44, 0.48), (0.00, 0.06), z) for z in np.arange(0.008, 0.06, 0.004)])
    bottom = np.array([0.0, 0.0, 1.0, -0.006])  # of a bin
    assert uppermost_on([seen(LOWER), seen(column)], 0, bottom) == []
    floats = column[column[:, 2] > 0.03]
    assert uppermost_on([seen(LOWER), seen(floats)], 0, bottom) == [1]
    corner = patch((0.471, 0.489), (0.046, 0.059), 0.06)  # some 3 of 72 cm²
    assert list(lying_on([seen(LOWER), seen(corner)], 0)) == [1]
    assert uppermost_on([seen(LOWER), seen(corner)], 0, bottom) == []
    above = [seen(LOWER), seen(UPPER), seen(corner + np.array([-0.02, 0, 0.03]))]
    assert uppermost_on(above, 0, bottom) == [1]
    above[2] = seen(patch((0.45, 0.47), (0.04, 0.06), 0.09))  # 4 of the upper one's 32 cm²
    assert uppermost_on(above, 0, bottom) == [2]


def test_what_stands_in_the_bay_of_a_thing_is_not_taken_off_it():
    two_grips = np.concatenate(
        [
            patch((0.40, 0.43), (0.0, 0.12), 0.03),
            patch((0.40, 0.52), (0.0, 0.03), 0.03),
            patch((0.49, 0.52), (0.0, 0.12), 0.03),
        ]
    )
    between = patch((0.435, 0.485), (0.10, 0.18), 0.06)
    assert list(lying_on([seen(two_grips), seen(between)], 0)) == [1]
    across = patch((0.38, 0.54), (0.06, 0.10), 0.06)
    assert uppermost_on([seen(two_grips), seen(between)], 0) == []
    assert uppermost_on([seen(two_grips), seen(across)], 0) == [1]


def test_what_is_pushed_aside_loses_its_rim_and_what_is_thin_is_not_pushed():
    block, rod = patch((0.40, 0.46), (0.0, 0.08), 0.03), patch((0.40, 0.41), (0.0, 0.10), 0.01)
    inner = without_rim(block, 0.008)
    assert inner.min(axis=0) == pytest.approx([0.408, 0.008, 0.03], abs=0.005)
    assert inner.max(axis=0) == pytest.approx([0.452, 0.072, 0.03], abs=0.005)
    assert len(without_rim(rod, 0.008)) == len(rod)


def test_the_bottom_of_a_bin_is_what_an_object_lies_on_and_noise_on_a_table_is_not():
    rng = np.random.default_rng(0)
    thing, table = patch((0.45, 0.50), (0.0, 0.05), 0.04), patch((0.3, 0.7), (-0.2, 0.2), 0.0, 0.004)
    table[:, 2] += rng.normal(0, 0.002, len(table))
    assert np.array_equal(floor_below(thing, np.concatenate([table, thing]), TABLE), TABLE)
    bottom = table + np.array([0, 0, 0.006])
    assert floor_below(thing, np.concatenate([bottom, thing]), TABLE) == pytest.approx([0, 0, 1, -0.006], abs=3e-4)


def test_what_lies_on_another_stays_apart_over_views_though_their_middles_are_near():
    merged = merge([seen(LOWER), seen(UPPER)], [seen(UPPER + 0.002), seen(LOWER + 0.002)])
    assert sorted(len(each.points) for each in merged) == sorted([2 * len(LOWER), 2 * len(UPPER)])


@pytest.mark.parametrize(("certainty", "count"), [(0.6, 2), (0.9, 1)])
def test_of_two_views_that_cut_otherwise_the_surer_one_counts(certainty, count):
    heap = seen(np.concatenate([LOWER, UPPER]), certainty, mouse=1.0)
    parts = [seen(LOWER, 0.8, mouse=1.0), seen(UPPER, 0.8, mouse=1.0)]
    assert len(merge([heap], parts)) == count
    assert len(merge(parts, [heap])) == count


def test_of_two_views_that_cut_otherwise_that_counts_which_the_classifier_knows():
    heap = seen(np.concatenate([LOWER, UPPER]), 0.9, mouse=0.04, **{UNKNOWN: 0.96})
    parts = [seen(LOWER, 0.6, mouse=0.95, **{UNKNOWN: 0.05}), seen(UPPER, 0.6, mouse=0.05, **{UNKNOWN: 0.95})]
    assert len(merge([heap], parts)) == len(merge(parts, [heap])) == 2
    known = seen(heap.points, 0.9, mouse=0.95, **{UNKNOWN: 0.05})
    assert len(merge([known], parts)) == len(merge(parts, [known])) == 1


def test_within_a_frame_what_can_be_trusted_most_counts_and_what_lies_over_it_does_not():
    left, right, other = np.arange(100), np.arange(100, 180), np.arange(300, 400)
    heap, alone = seen(LOWER, 0.9, mouse=0.1, **{UNKNOWN: 0.9}), seen(UPPER, 0.9, mouse=0.9, **{UNKNOWN: 0.1})
    pieces = [seen(LOWER_LEFT, 0.6, mouse=0.9, **{UNKNOWN: 0.1}), seen(LOWER_RIGHT, 0.6, **{UNKNOWN: 0.9})]
    halves = [seen(UPPER, 0.5, mouse=0.9, **{UNKNOWN: 0.1})] * 2
    pixels = [np.concatenate([left, right]), other, left, right, other[:50], other[50:]]
    assert most_trusted([heap, alone, *pieces, *halves], pixels) == [1, 2, 3]
    speck = seen(UPPER)  # too small for the classifier
    assert most_trusted([heap, speck], [left, left[:50]]) == [0]
    assert most_trusted([heap, alone], [left, np.append(left[:10], other)]) == [1, 0]  # they share an edge
    assert most_trusted([], []) == []


def test_two_that_adjoin_are_looked_at_as_one_too():
    both = [seen(LOWER_LEFT, 0.6), seen(LOWER_RIGHT, 0.9)]
    clouds, pixels = [each.points for each in both], [np.arange(5), np.arange(5, 8)]
    view = View(None, both, clouds, pixels, None, np.empty((0, 3)), [Cut(0, 1, 0.6)])
    paired = view.with_pairs()
    assert paired.objects[:2] == both
    np.testing.assert_array_equal(paired.objects[2].points, np.concatenate(clouds))
    np.testing.assert_array_equal(paired.pixels[2], np.arange(8))
    assert paired.objects[2].certainty == pytest.approx(0.4)
    assert len(paired.clouds) == 3


def test_of_two_that_may_be_it_the_one_that_is_surely_whole_is_taken():
    objects = [seen(LOWER, 0.5, mouse=0.95, cup=0.05), seen(UPPER, 0.8, mouse=0.9, cup=0.1), seen(TOP, 0.9, cup=1.0)]
    log = PolicyLog()
    assert PickPlanner(None, None, None, 0.6, "mouse", log).likeliest(objects) == 1
    assert log.confidence == pytest.approx(0.9)


class _Taught:
    unknown_below = 0.25


def test_what_one_view_alone_shows_and_not_surely_is_not_touched():
    planner = PickPlanner(_Taught(), None, None, 0.6, "mouse", PolicyLog())
    unsure, whole = seen(LOWER, 0.6, mouse=0.95, cup=0.05), seen(LOWER, 0.8, mouse=0.85, cup=0.15)
    assert not planner.is_confirmed([unsure], 2)
    assert planner.is_confirmed(merge([unsure], [seen(LOWER, 0.6, mouse=0.95, cup=0.05)]), 2)
    assert planner.is_confirmed([], 2)
    assert planner.is_confirmed([whole], 1)
    assert not planner.is_confirmed([whole], 4), "three other views show it otherwise"


def test_what_others_lie_on_is_not_touched_where_both_witnesses_doubt_that_it_is_whole():
    vague = {"mouse": 0.3, UNKNOWN: 0.7}
    planner = PickPlanner(_Taught(), None, None, 0.6, "mouse", PolicyLog())
    upper = seen(UPPER, 0.9, cup=1.0)
    doubtful, whole = (SeenObject(LOWER, False, [vague, vague], certainty=each) for each in (0.6, 0.8))
    assert planner.is_confirmed([doubtful], 4)
    assert not planner.is_confirmed([doubtful, upper], 4)
    assert planner.is_confirmed([whole, upper], 4)
    clears = PickPlanner(_Taught(), None, None, 0.6, "mouse", PolicyLog(), clear=True)
    assert clears.is_confirmed([doubtful, upper], 4), "it can be looked at again once what lies on it is away"


def test_two_views_that_agree_beyond_doubt_are_enough():
    planner = PickPlanner(_Taught(), None, None, 0.6, "mouse", PolicyLog())
    clear = {"mouse": 0.594, "cup": 0.006, UNKNOWN: 0.4}
    once = [SeenObject(LOWER, False, [clear], certainty=0.9)]
    assert not planner.is_found(once)
    assert planner.is_found(merge(once, [SeenObject(LOWER, False, [clear], certainty=0.9)]))
    vague, strange = {"mouse": 0.5, "cup": 0.1, UNKNOWN: 0.4}, {"mouse": 0.4, UNKNOWN: 0.6}
    assert not planner.is_found([SeenObject(LOWER, False, [strange, strange], certainty=0.9)])
    assert not planner.is_found([SeenObject(LOWER, False, [vague, vague], certainty=0.9)])
    assert not planner.is_found([SeenObject(LOWER, False, [clear, clear], certainty=0.6)])


def test_what_looks_clearly_like_one_class_is_touched_though_it_is_hardly_known_and_other_things_are_not():
    def takes(known, share, classifier=None):
        mouse = {"mouse": known * share, "cup": known * (1 - share), UNKNOWN: 1 - known}
        return PickPlanner(classifier or _Taught(), None, None, 0.9, "mouse", PolicyLog()).choose(
            [seen(LOWER, 0.8, **mouse)]
        )

    assert seen(LOWER, mouse=0.3 * 0.99, cup=0.3 * 0.01, **{UNKNOWN: 0.7}).is_a("mouse") == pytest.approx(
        3 / 7 * 99 / (1 + 3 / 7 * 99)
    )
    assert takes(0.3, 0.99) == 0
    assert takes(0.3, 0.92) is None  # 3 : 7 times 92 : 8 is 83 %
    assert takes(0.2, 0.99) is None  # unknown by the classifier's own threshold
    assert takes(0.95, 0.8) is None  # known well, but not as a mouse
    assert takes(0.3, 0.99, classifier=object()) is None  # even odds where it has no threshold


def test_an_object_is_trusted_by_all_three_witnesses():
    clear = seen(LOWER, 0.8, mouse=0.9 * 0.5, cup=0.1 * 0.5, **{UNKNOWN: 0.5})
    assert clear.trust == pytest.approx(36 / 37)  # 4 : 1 times 1 : 1 times 9 : 1
    assert seen(LOWER, 0.8, mouse=0.5 * 0.5, cup=0.5 * 0.5, **{UNKNOWN: 0.5}).trust == pytest.approx(0.8)
    assert seen(LOWER, 0.8).trust == 0.0  # too small for the classifier


@pytest.mark.parametrize("covered", [True, False])
def test_of_two_of_the_class_that_is_taken_on_which_nothing_lies(covered):
    likeliest, other = seen(LOWER, 0.9, mouse=0.99, cup=0.01), seen(AWAY, 0.8, mouse=0.95, cup=0.05)
    objects = [likeliest, other, *([seen(UPPER, 0.9, cup=1.0)] if covered else [])]
    for each in objects:
        each.evidence = each.evidence * 2
    view = View(None, objects, [], [], TABLE, np.zeros((0, 3)))
    view.__dict__["surface"] = np.zeros((0, 3))
    log = PolicyLog()
    PickPlanner(None, CurvaturePlanner(ROBOTIQ_2F_140), None, 0.6, "mouse", log).decide(objects, view, None)
    assert log.chosen == (1 if covered else 0)


def block(x, y, height):
    """What is seen of a box on the table from all sides."""
    heights = np.arange(0.004, height, 0.004)
    along_x = np.stack(np.meshgrid(np.arange(*x, 0.002), y, heights, indexing="ij"), axis=-1).reshape(-1, 3)
    along_y = np.stack(np.meshgrid(x, np.arange(*y, 0.002), heights, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([patch(x, y, height), along_x, along_y])


def test_what_could_be_held_by_its_top_only_is_held_deeper_beside_neighbours_that_give_way():
    asked = seen(block((0.47, 0.53), (0.0, 0.04), 0.058), mouse=1.0)
    ends = [block((0.40, 0.458), (0.0, 0.04), 0.045), block((0.542, 0.60), (0.0, 0.04), 0.045)]
    sides = [block((0.40, 0.60), (-0.072, -0.012), 0.045), block((0.40, 0.60), (0.052, 0.112), 0.045)]
    objects = [asked, *(seen(each, cup=1.0) for each in ends + sides)]
    view = View(None, objects, [], [], TABLE, np.zeros((0, 3)))
    view.__dict__["surface"] = np.zeros((0, 3))
    log = PolicyLog()
    planner = CurvaturePlanner(ROBOTIQ_2F_140)
    pick = PickPlanner(None, planner, None, 0.6, "mouse", log).decide(objects, view, None)
    assert pick.plan.best.terms["bite"] > 0.5
    assert log.doubts == ["no free way for the fingers: they may push a neighbour aside"]
    free = planner.plan(
        asked.points, up=[0, 0, 1], table=TABLE, obstacles=np.concatenate([each.points for each in objects[1:]])
    )
    assert free.best.terms["bite"] < 0.5


def test_where_the_arm_has_no_room_from_straight_above_the_hand_comes_in_tilted():
    long = seen(block((0.48, 0.52), (-0.08, 0.08), 0.05), mouse=1.0)
    posts = np.concatenate([block((0.47, 0.53), (side - 0.02, side + 0.02), 0.25) for side in (-0.13, 0.13)])
    planner, q = CurvaturePlanner(ROBOTIQ_2F_140), HOME[:6].astype(float)
    straight = planner.plan(long.points, up=[0, 0, 1], table=TABLE, obstacles=posts)
    with pytest.raises(MotionError, match="another object is in the arm's way"):  # the camera beside the hand
        plan_approach(straight, long.points, posts, TABLE, q)
    view = View(RobotObservation(q, ROBOTIQ_2F_140.stroke, lambda: None), [long], [], [], TABLE, posts)
    view.__dict__["surface"] = np.zeros((0, 3))
    pick = PickPlanner(None, planner, None, 0.6, "mouse", PolicyLog()).decide([long], view, q)
    assert pick.reason is None
    assert pick.approach.grasp.terms["tilt"] > 0.1
    assert planner.min_tilt == 0.0


def test_places_are_free_where_the_table_was_seen_and_nothing_stands():
    table = patch((0.3, 0.7), (-0.3, 0.3), 0.0, 0.003)
    thing = patch((0.45, 0.55), (-0.05, 0.05), 0.05)
    surface = np.concatenate([table, thing])
    angles = np.linspace(0, 2 * np.pi, 60)[:, None]
    ring = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
    places = free_places(surface, surface[:, 2], 0.06 * ring)
    assert len(places) > 100
    beyond = np.maximum(np.abs(places - [0.5, 0.0]) - 0.05, 0.0)
    assert (np.linalg.norm(beyond, axis=1) > 0.07).all()
    assert (places.min(axis=0) > [0.37, -0.23]).all()
    assert (places.max(axis=0) < [0.63, 0.23]).all()
    assert len(free_places(surface, surface[:, 2], 0.4 * ring)) == 0


def test_a_full_table_has_no_place():
    full = patch((0.2, 0.8), (-0.4, 0.4), 0.05, 0.003)
    with pytest.raises(MotionError, match="no free place"):
        plan_put_down(LOWER, HOME, HOME, 0.04, full, TABLE)


class _Labels:
    """The class of the object whose middle is nearest in space."""

    def __init__(self, env):
        self.task = env.unwrapped

    def __call__(self, points):
        q = self.task.agent.robot.get_qpos()[0, :6].numpy().astype(float)
        T = forward_kinematics(q) @ T_TOOL0_CAMERA
        top = (points @ T[:3, :3].T + T[:3, 3]).mean(axis=0)
        places = [actor.pose.p[0].numpy() for actor in self.task.objects]
        nearest = int(np.argmin([np.linalg.norm(place - top) for place in places]))
        return self.task.models[0][nearest].class_name, 0.99


class _TrueSegments:
    """Tells objects apart as the renderer does."""

    def __init__(self, policy_segmenter, env):
        self.segmenter, self.task, self.obs = policy_segmenter, env.unwrapped, None

    def segment(self, cloud, **given):
        scene = self.segmenter.segment(cloud, **given)
        numbers = self.obs["sensor_data"]["wrist_camera"]["segmentation"][0, ..., 0].numpy().reshape(-1)
        points = cloud.reshape(-1, 3)
        ids = [int(actor.per_scene_id[0]) for actor in self.task.objects]
        indices = [np.flatnonzero((numbers == i) & np.isfinite(points[:, 2])) for i in ids]
        return scene.__class__(
            [points[each] for each in indices],
            indices,
            scene.plane,
            [False] * len(ids),
            [False] * len(ids),
            unseen=[np.zeros((0, 3))] * len(ids),
            viewpoint=scene.viewpoint,
        )


@pytest.fixture
def stacked():
    """Makes a task with a plug adapter that lies on the asked-for joypad, and plays an episode in it."""
    envs = []

    def play(clears, **settings):
        env = gym.make(
            "SelectiveGrasp-v1",
            obs_mode="depth+segmentation",
            control_mode="pd_joint_pos",
            sim_backend="physx_cpu",
            render_backend="cpu",
            n_objects=2,
            max_episode_steps=800,
            **settings,
        )
        envs.append(env)
        _, info = env.reset(seed=0, options={"objects": ["joypad", "plug_adapter"], "target": "joypad"})
        task = env.unwrapped
        below, above = task.objects
        pose = above.pose.raw_pose.clone()
        pose[:, :2] = below.pose.p[:, :2]
        pose[:, 2] += 0.06
        above.set_pose(Pose.create(pose))
        policy = ScriptedPolicy(_Labels(env), clear=clears)
        policy.segmenter = segments = _TrueSegments(policy.segmenter, env)
        policy.reset(info["target"][0])
        action = np.array([*HOME, 0.14, 60.0], np.float32)
        terminated = False
        for _ in range(25):
            obs, *_ = env.step(action)
        task.memory.air_at_start = air_below(task.table.poses(), task.table.hull_vertices).clamp(min=0.0)
        while not (policy.done or terminated):
            segments.obs = obs
            obs, _, terminated, _, info = env.step(policy.act(obs))
        for _ in range(20):
            if not terminated:
                obs, _, terminated, _, info = env.step(policy.act(obs))
        return policy.log, info, below, above

    yield play
    for env in envs:
        env.close()


@pytest.mark.slow
@pytest.mark.parametrize("clear", [True, False])
def test_what_lies_on_the_asked_for_object_is_put_down_beside_it_first(stacked, clear):
    log, info, below, above = stacked(True, clear=clear, objects=Catalogue(LARS_CLASSES, instances_per_class=2))
    assert bool(info["wrong_object"]) is not clear
    if clear:
        assert info["success"]
        assert log.cleared == 1
        assert torch.linalg.norm(above.pose.p[0, :2] - below.pose.p[0, :2]) > 0.08
        assert float(above.pose.p[0, 2]) < 0.05


@pytest.mark.slow
def test_what_may_not_be_taken_away_slides_off_when_the_object_below_is_tipped(stacked):
    log, info, _, above = stacked(False, objects=Catalogue(LARS_CLASSES, instances_per_class=4))
    assert info["success"]
    assert "something lies on it: it is tipped while it is lifted" in log.doubts
    assert float(above.pose.p[0, 2]) < 0.05
