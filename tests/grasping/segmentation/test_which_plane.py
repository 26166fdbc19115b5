"""Which of several planes is the table: floors, walls, seats, the sides of a bin."""

import numpy as np
import pytest
from rendered_scenes import look_down, up_in
from scipy.spatial.transform import Rotation

from grasping import Scene, Segmenter

W, H, FOCAL = 320, 240, 260.0
RAYS = np.stack(np.meshgrid((np.arange(W) + 0.5 - W / 2) / FOCAL, (np.arange(H) + 0.5 - H / 2) / FOCAL), axis=-1)
RAYS = np.concatenate([RAYS, np.ones((H, W, 1))], axis=-1)


def board(centre, size, tilt=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A rectangle of this size in its own x and y, turned by degrees about x, y and z."""
    return (
        np.asarray(centre, float),
        Rotation.from_euler("xyz", tilt, degrees=True).as_matrix(),
        np.asarray(size, float),
    )


def block(x, y, z, length, width, height) -> list:
    """The top and the sides of a box that stands at height z."""
    top = board((x, y, z + height), (length, width))
    sides = [board((x + sx * length / 2, y, z + height / 2), (height, width), (0, 90, 0)) for sx in (-1, 1)] + [
        board((x, y + sy * width / 2, z + height / 2), (length, height), (90, 0, 0)) for sy in (-1, 1)
    ]
    return [top, *sides]


def picture(T: np.ndarray, boards: list, noise: float = 0.001) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) of rectangles, and the number (H, W) of the one that is seen, −1 for none."""
    world, eye = RAYS @ T[:3, :3].T, T[:3, 3]
    depth, owner = np.full((H, W), np.inf), np.full((H, W), -1)
    for number, (centre, turn, size) in enumerate(boards):
        ray, start = world @ turn, (eye - centre) @ turn
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -start[2] / ray[..., 2]
            place = start + at[..., None] * ray
            hit = (at > 0) & (at < depth) & (np.abs(place[..., :2]) < size / 2).all(axis=-1)
        depth, owner = np.where(hit, at, depth), np.where(hit, number, owner)
    owner[~(depth < 4.0)] = -1
    depth[~(depth < 4.0)] = np.nan
    depth += np.random.default_rng(0).normal(size=depth.shape) * noise * (depth / 0.6) ** 2
    return (RAYS * depth[..., None]).astype(np.float32), owner


def from_above(pitch: float, height: float, turn: float = 0.0) -> np.ndarray:
    """T_world_camera: over y > 0, looking at the origin, pitched down by so many degrees, upright but for `turn`."""
    T = look_down(90.0 - pitch, height / np.sin(np.radians(pitch)))
    T[:3, :3] = T[:3, :3] @ Rotation.from_euler("z", 180 + turn, degrees=True).as_matrix()
    return T


def told(frame: np.ndarray, **how) -> list[Scene]:
    """The scenes of several seeds, which must agree."""
    scenes = [Segmenter(depth_range=(0.0, 4.0), seed=seed).segment(frame, **how) for seed in range(5)]
    assert all(scene.plane is not None for scene in scenes)
    for scene in scenes[1:]:
        assert scene.plane[:3] @ scenes[0].plane[:3] > np.cos(np.radians(0.5))
        assert scene.plane[3] == pytest.approx(scenes[0].plane[3], abs=0.005)
        assert [len(points) for points in scene.objects] == pytest.approx([len(p) for p in scenes[0].objects], rel=0.1)
    return scenes


def normal_of(T: np.ndarray, plane: np.ndarray) -> np.ndarray:
    return T[:3, :3] @ plane[:3]


@pytest.mark.parametrize("how", ["organised", "loose", "up"])
@pytest.mark.parametrize("turn", [0.0, 10.0])
def test_a_desk_of_a_fifth_of_the_view_7_degrees_off_the_floor_is_the_table(how: str, turn: float) -> None:
    T = from_above(50.0, 1.25, turn)
    desk = board((0.1, 0.0, 0.0), (1.1, 0.9), (7.0, 0.0, 0.0))
    things = block(0.1, 0.0, 0.0, 0.08, 0.06, 0.12) + block(0.25, -0.12, 0.0, 0.06, 0.06, 0.10)
    chairs = [board((x, -1.1, -0.28), (0.42, 0.42)) for x in (-0.5, 0.4)]
    frame, owner = picture(T, [desk, board((0, 0, -0.73), (6, 6)), *chairs, *things])
    assert 0.15 < (owner == 0).mean() < 0.25
    assert (owner == 1).mean() > 2 * (owner == 0).mean()
    cloud = frame if how != "loose" else frame.reshape(-1, 3)[(owner >= 0).reshape(-1)]
    scenes = told(cloud, **({"up": up_in(T)} if how == "up" else {}))
    expected = Rotation.from_euler("x", 7, degrees=True).as_matrix()[:, 2]
    for scene in scenes:
        assert normal_of(T, scene.plane) @ expected > np.cos(np.radians(1.0))
        assert len(scene.objects) == 2
        assert any("below the table" in each.why for each in scene.rejected if each.what == "plane")
        assert len(scene.other_planes) >= 1


@pytest.mark.parametrize("pitch", [20.0, 30.0, 40.0])
@pytest.mark.parametrize("organised", [True, False])
def test_a_wall_is_never_the_table_where_something_flatter_is_there(pitch: float, organised: bool) -> None:
    T = from_above(pitch, 0.5)
    wall = board((0.0, -0.16, 1.0), (5, 5), (90, 0, 0))
    frame, owner = picture(T, [board((0, 0.06, 0), (1.0, 0.44)), wall, *block(0, 0, 0, 0.08, 0.06, 0.1)], 0.0003)
    assert (owner == 1).mean() > 0.9 * (owner == 0).mean()
    cloud = frame if organised else frame.reshape(-1, 3)[(owner >= 0).reshape(-1)]
    for scene in told(cloud):
        assert normal_of(T, scene.plane)[2] > 0.999
        assert len(scene.objects) == 1
        assert any("90° against the table" in each.why for each in scene.rejected if each.what == "plane")


@pytest.mark.parametrize("pitch", [55.0, 70.0, 88.0])
def test_a_bins_side_is_not_the_table(pitch: float) -> None:
    T = from_above(pitch, 0.75)
    walls = [board((sx * 0.3, 0, 0.12), (0.24, 0.4), (0, 90, 0)) for sx in (-1, 1)]
    walls += [board((0, sy * 0.2, 0.12), (0.6, 0.24), (90, 0, 0)) for sy in (-1, 1)]
    frame, _ = picture(T, [board((0, 0, 0), (0.6, 0.4)), *walls, *block(0.05, 0, 0, 0.1, 0.06, 0.05)])
    for scene in told(frame):
        assert normal_of(T, scene.plane)[2] > 0.999
        assert abs((T[:3, :3] @ (-scene.plane[3] * scene.plane[:3]) + T[:3, 3])[2]) < 0.005


@pytest.mark.parametrize("height", [0.45, 0.75])
def test_a_table_far_over_the_frames_origin_is_not_taken_from_below(height: float) -> None:
    """A robot's frame on the floor: the origin lies under the table, where no camera stands."""
    T = from_above(50.0, 0.6)
    frame, _ = picture(T, [board((0, 0, 0), (0.8, 0.8)), *block(0, 0, 0, 0.08, 0.06, 0.1)])
    world = frame @ T[:3, :3].T + T[:3, 3] + [0.3, 0.0, height]
    for cloud in (world.reshape(-1, 3)[np.isfinite(world[..., 0]).reshape(-1)], world):
        for scene in told(cloud):
            assert scene.plane[2] > 0.999
            assert scene.viewpoint is None
            assert len(scene.objects) == 1
