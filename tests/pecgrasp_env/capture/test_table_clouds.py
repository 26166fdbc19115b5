"""Labelled frames as clouds of tables and of cut-outs: labels are true, objects of two sets are not shared."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasping import Segmenter
from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, write_manifest
from pec.errors import ConfigError, DatasetError
from pec.segmentation.clouds import read_clouds
from pecgrasp_env.capture.scenes.config import FramesConfig, SceneObjectsConfig
from pecgrasp_env.capture.scenes.cut_outs import FOUND, cut_out_clouds, overlaps
from pecgrasp_env.capture.scenes.frames import FIRST_OBJECT, LabelledFrame, cloud_of, frames_of
from pecgrasp_env.capture.scenes.generate import generate_frames
from pecgrasp_env.capture.scenes.table_clouds import (
    check_apart,
    object_classes,
    pixel_classes,
    table_cloud,
    table_clouds,
)

OBJECTS = SceneObjectsConfig(classes=("mouse", "stapler"), plain_share=0.3, plain_instances=3, catalogue_instances=1)
CONFIG = FramesConfig(
    scenes=4, frames_per_scene=1, objects=OBJECTS, fewest=3, most=5, kinds={"apart": 1.0},
    cameras={"d435_424x240": 1.0}, shard_size=2, val_share=0.25, seed=3,
)  # fmt: skip
CLASSES = ["mouse", "stapler", "unknown"]


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("frames")
    generate_frames(CONFIG, directory, workers=1)
    return directory


def test_what_stands_on_the_table_is_the_objects_at_their_height(frames):
    names = read_manifest(frames).classes
    for frame in frames_of(frames):
        cloud = cloud_of(frame)
        table = table_cloud(Segmenter().segment(cloud), cloud)
        assert table is not None
        labels = frame.instance.reshape(-1)
        on_object = np.isfinite(cloud.reshape(-1, 3)[:, 2]) & (labels >= FIRST_OBJECT)
        kept = np.isin(np.flatnonzero(on_object), table.pixel)
        assert kept.mean() > 0.85
        world = cloud.reshape(-1, 3)[table.pixel] @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]
        on_object = labels[table.pixel] >= FIRST_OBJECT
        np.testing.assert_allclose(table.points[on_object, 2], world[on_object, 2], atol=0.006)
        of_object = object_classes(frame, names, CLASSES)
        of_pixel = pixel_classes(frame, of_object, 2)
        for row, name in enumerate(names[index] for index in frame.class_index):
            assert set(of_pixel[labels == FIRST_OBJECT + row]) <= {CLASSES.index(name) if name in CLASSES else 2}


def test_the_file_is_made_once_and_anew_for_other_frames(frames):
    path = table_clouds(frames, 512)
    clouds = read_clouds(path, 512)
    assert (clouds.classes, clouds.points.shape) == (CLASSES, (4, 512, 3))
    assert clouds.val.tolist() == [False, False, False, True]
    assert set(clouds.label.unique().tolist()) == {0, 1, 2}
    assert clouds.points[..., 2].min() >= 0
    assert clouds.points[..., :2].mean(dim=1).abs().max() < 1e-4
    before = path.stat().st_mtime_ns
    assert table_clouds(frames, 512) == path
    assert path.stat().st_mtime_ns == before
    manifest = read_manifest(frames)
    write_manifest(frames, replace(manifest, shards=manifest.shards[:1]))
    try:
        assert len(read_clouds(table_clouds(frames, 512), 512)) == 2
        write_manifest(frames, replace(manifest, complete=False))
        with pytest.raises(DatasetError, match="is unfinished"):
            table_clouds(frames, 512)
        config = manifest.config | {"objects": manifest.config["objects"] | {"classes": None}}
        write_manifest(frames, replace(manifest, config=config))
        with pytest.raises(DatasetError, match=r"generated without objects\.classes="):
            table_clouds(frames, 512)
    finally:
        write_manifest(frames, manifest)


def test_cut_outs_are_of_the_class_of_what_they_overlap(frames, tmp_path):
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cut_out_clouds(frames, tmp_path / "cuts", stop)
    clouds = load_dataset(cut_out_clouds(frames, tmp_path / "cuts"))
    manifest = read_manifest(frames)
    expected = dict.fromkeys(CLASSES, 0)
    for frame in frames_of(frames, val=False):
        scene = Segmenter().segment(cloud_of(frame))
        for points, overlap in zip(scene.objects, overlaps(scene.indices, frame), strict=True):
            name = manifest.classes[frame.class_index[overlap.argmax()]] if overlap.max() >= FOUND else "unknown"
            expected[name if name in CLASSES else "unknown"] += len(points) >= 64
    assert {name: int((clouds.labels == i).sum()) for i, name in enumerate(clouds.classes)} == expected
    assert min(expected[name] for name in CLASSES[:2]) > 0
    write_manifest(tmp_path, replace(manifest, complete=False))
    with pytest.raises(DatasetError, match="is unfinished"):
        cut_out_clouds(tmp_path, tmp_path / "others")
    write_manifest(tmp_path, replace(manifest, shards=manifest.shards[:1]))
    with pytest.raises(DatasetError, match="holds clouds of other frames"):
        cut_out_clouds(tmp_path, tmp_path / "cuts")


def test_overlap_is_over_measured_pixels():
    instance = np.array([[1, 2, 2, 2], [1, 3, 3, 2]], np.uint8)
    depth = np.array([[1, 1, 1, 0], [1, 1, 1, 1]], np.float32)
    frame = LabelledFrame(
        depth, instance, np.eye(3), np.eye(4), 0, 0, 0, 0, False, np.zeros(2, int), np.zeros((2, 7)), np.ones(2)
    )
    shares = overlaps([np.array([1, 2]), np.array([5, 6, 7]), np.array([0])], frame)
    np.testing.assert_allclose(shares, [[2 / 3, 0], [1 / 5, 2 / 3], [0, 0]])
    assert overlaps([], frame).shape == (0, 2)


def test_sets_that_share_objects_are_refused(frames, tmp_path):
    manifest = read_manifest(frames)

    def other(name: str, **objects: object) -> Path:
        config = manifest.config | {"objects": manifest.config["objects"] | objects}
        write_manifest(tmp_path / name, replace(manifest, config=config))
        return tmp_path / name

    check_apart(frames, other("apart", seed=3))
    with pytest.raises(
        ConfigError, match=r"shares objects with .*objects\.seed=2 and 0 with objects\.plain_instances 3"
    ):
        check_apart(frames, other("near", seed=2))
    with pytest.raises(ConfigError, match=r"objects\.catalogue_instances 1 and 9"):
        check_apart(other("many", catalogue_instances=9), other("after", seed=5))
    with pytest.raises(ConfigError, match="from the folder meshes"):
        check_apart(other("folder", path="meshes"), other("the same", path="meshes", seed=50))
