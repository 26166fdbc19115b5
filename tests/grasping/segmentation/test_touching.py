"""Things that touch, lie on each other and hide each other, seen by a noisy camera."""

import numpy as np
import pytest

from grasping import Segmenter
from grasping.errors import ConfigError
from tests.grasping.rendered_scenes import look_down, owners_of, render, share_found, up_in

NOISE = 0.001

# x, y, length, width, height, z0
SIDE_BY_SIDE = [(-0.045, 0.0, 0.09, 0.07, 0.06), (0.04, 0.03, 0.08, 0.08, 0.10)]
STACKED = [(0.0, 0.0, 0.16, 0.12, 0.06), (0.02, 0.01, 0.07, 0.06, 0.05, 0.06)]
HIDDEN = [(0.0, -0.05, 0.26, 0.05, 0.07), (0.0, 0.06, 0.06, 0.05, 0.13)]
# No two faces in one plane: of flush faces nobody can tell.
HEAP = [
    (0.13 * (i % 4) - 0.2, 0.11 * (i // 4) + 0.012 * (i % 3) - 0.07, 0.13, 0.11, 0.05 + 0.023 * ((3 * i + i // 4) % 5))
    for i in range(8)
]


@pytest.mark.parametrize("boxes", [SIDE_BY_SIDE, STACKED, HIDDEN], ids=["side by side", "stacked", "hidden"])
@pytest.mark.parametrize("distance", [0.6, 0.8])
def test_each_is_an_object_of_its_own(boxes: list[tuple], distance: float) -> None:
    T = look_down(45.0, distance)
    frame, owner = render(boxes, T, NOISE)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert sorted(max(shares, key=shares.get) for shares in owners_of(scene, owner)) == list(range(len(boxes)))
    for number, shares in enumerate(owners_of(scene, owner)):
        assert max(shares.values()) > 0.9, number
    assert all(share_found(scene, owner, box) > 0.9 for box in range(len(boxes)))


def test_how_sure_it_is_is_said_for_objects_and_for_the_cuts_between_neighbours() -> None:
    T = look_down(45.0, 0.7)
    apart = (-0.22, -0.05, 0.06, 0.06, 0.06)
    frame, owner = render([*SIDE_BY_SIDE, apart], T, NOISE)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == len(scene.confidence) == 3
    assert all(0 <= sure <= 1 for sure in scene.confidence)
    box = [max(shares, key=shares.get) for shares in owners_of(scene, owner)]
    (cut,) = scene.cuts
    assert cut.first < cut.second
    assert {box[cut.first], box[cut.second]} == {0, 1}
    assert 0.5 < cut.sure <= 1


def test_whoever_would_rather_have_pieces_than_two_in_one_may_say_so() -> None:
    T = look_down(45.0, 0.7)
    frame, _ = render(SIDE_BY_SIDE, T, NOISE)
    joined, usual, cut = (
        len(Segmenter(**kwargs).segment(frame, up=up_in(T)).objects)
        for kwargs in ({"whole_rather": 9.0}, {}, {"whole_rather": -9.0})
    )
    assert joined == 1
    assert usual == 2
    assert cut > 2


def test_a_heap_wider_than_any_object_is_taken_apart_and_not_left_out() -> None:
    T = look_down(40.0, 0.9)
    frame, owner = render(HEAP, T, NOISE)
    scene = Segmenter().segment(frame, up=up_in(T))
    whole = [box for box in range(len(HEAP)) if share_found(scene, owner, box) > 0.85]
    assert len(whole) >= 6
    assert not any("m large" in entry.why for entry in scene.rejected)


@pytest.mark.parametrize("height", [0.004, 0.006])
def test_a_flat_thing_stands_out_of_the_noise(height: float) -> None:
    T = look_down(30.0, 0.6)
    frame, owner = render([(0.0, 0.0, 0.12, 0.03, height)], T, 0.0008)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == 1
    assert share_found(scene, owner, 0) > 0.8


def test_a_loose_cloud_is_told_apart_as_the_frame_is() -> None:
    T = look_down(45.0, 0.7)
    frame, owner = render(SIDE_BY_SIDE, T, NOISE)
    seen = np.isfinite(frame[..., 2])
    world = frame[seen] @ T[:3, :3].T + T[:3, 3]
    for cloud, up, viewpoint in ((frame[seen], up_in(T), None), (world, [0, 0, 1], T[:3, 3])):
        scene = Segmenter().segment(cloud, up=up, viewpoint=viewpoint)
        assert sorted(max(shares, key=shares.get) for shares in owners_of(scene, owner[seen])) == [0, 1]
    (together,) = Segmenter().segment(world, up=[0, 0, 1]).objects  # from where it was seen nobody knows
    assert len(together) > 0.9 * (owner >= 0).sum()


def test_a_file_that_is_no_trees_is_refused(tmp_path) -> None:
    frame, _ = render(SIDE_BY_SIDE, look_down(45.0, 0.7), NOISE)
    (tmp_path / "mine.npz").write_bytes(b"none")
    with pytest.raises(ConfigError, match=r"mine\.npz: not a file of pecgrasp train-segmenter"):
        Segmenter(relations=tmp_path / "mine.npz").segment(frame)
    with pytest.raises(ConfigError, match=r"gone\.npz"):
        Segmenter(relations=tmp_path / "gone.npz").segment(frame)


@pytest.mark.parametrize("shadow", [0, 9])
@pytest.mark.parametrize("tilt", [40.0, 60.0])
def test_the_halves_of_a_box_behind_another_are_one_also_across_its_shadow(shadow: int, tilt: float) -> None:
    T = look_down(tilt, 0.75)
    frame, owner = render([(0.0, -0.05, 0.26, 0.07, 0.07), (0.0, 0.07, 0.06, 0.05, 0.15)], T, NOISE)
    if shadow:  # what one of a stereo camera's two eyes does not see beside a near thing is not measured
        near = owner == 1
        beside = near.copy()
        for step in range(1, shadow + 1):
            beside[:, step:] |= near[:, :-step]
            beside[:, :-step] |= near[:, step:]
        frame[beside & ~near] = np.nan
    scene = Segmenter().segment(frame, up=up_in(T))
    assert sorted(max(shares, key=shares.get) for shares in owners_of(scene, owner)) == [0, 1]
