"""Real clouds, where they are at hand: Kinect scenes with labels, and single clouds of other people."""

from pathlib import Path

import numpy as np
import pytest

from grasping import CurvaturePlanner, PublishedPlanner, Segmenter

REAL = Path(__file__).resolve().parents[4] / "shared" / "data" / "real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason=f"no real data at {REAL.parent}")


def mosd_frames() -> list[tuple[str, int, np.ndarray, np.ndarray]]:
    """(group, number of objects, frame (480, 640, 3), label // 10) of each scene."""
    with np.load(REAL / "tabletop_scenes_mosd.npz") as data:
        depth, label, group, count = data["depth_mm"], data["label"], data["group"], data["n_objects"]
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    scenes = []
    for i in range(len(depth)):
        z = depth[i] * 1e-3
        frame = np.stack([(u - 319.5) * z / 525, (v - 239.5) * z / 525, z], axis=-1).astype(np.float32)
        scenes.append((str(group[i]), int(count[i]), frame, label[i] // 10))
    return scenes


def test_boxes_that_stand_apart_on_a_real_table_are_found_one_by_one() -> None:
    expected, found, ghosts = 0, 0, 0
    for group, count, frame, owner in mosd_frames():
        if group != "boxes":
            continue
        scene = Segmenter().segment(frame)
        assert scene.plane is not None
        flat = owner.reshape(-1)
        expected += count
        for index in scene.indices:
            main = int(np.bincount(flat[index]).argmax())
            ghosts += main == 0
            found += (
                main > 0
                and (flat[index] == main).mean() > 0.9
                and (flat[index] == main).sum() > 0.7 * (flat == main).sum()
            )
    assert expected > 20
    assert found >= 0.9 * expected
    assert ghosts <= 0.1 * expected


def test_real_scenes_of_every_kind_have_a_table_and_a_grasp_or_a_reason_for_each_object() -> None:
    for _, _, frame, _ in mosd_frames()[::5]:
        scene = Segmenter().segment(frame)
        assert scene.plane is not None
        for points in scene.objects:
            plan = CurvaturePlanner().plan(points, table=scene.plane)
            assert (plan.best is None) == (plan.reason is not None)
            published = PublishedPlanner().plan(points, table=scene.plane)
            assert (published.best is None) == (published.reason is not None)


def test_single_real_clouds() -> None:
    with np.load(REAL / "clouds.npz") as data:
        krylon, mug, milk = (data[name] for name in data.files)
    can = CurvaturePlanner().plan(krylon)
    assert can.best is not None
    assert 0.04 < can.best.width < 0.09  # a spray can of about 65 mm
    on_table = Segmenter().segment(mug)
    assert on_table.plane is not None
    assert on_table.objects
    kinect = Segmenter().segment(milk)
    assert kinect.plane is not None
    assert len(kinect.objects) >= 2
