"""Labelled frames of crowded tables: drawn by seed, at rest, true to their masks, whole after an interruption."""

import hashlib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pec.errors import DatasetError
from pecgrasp_env.capture import CaptureError
from pecgrasp_env.capture.rendering.view_of_table import FROM_A_STAND, FROM_A_WRIST, draw_view
from pecgrasp_env.capture.scenes.arrangement import KINDS as ARRANGED
from pecgrasp_env.capture.scenes.arrangement import arrange_scene
from pecgrasp_env.capture.scenes.card import write_frames_card
from pecgrasp_env.capture.scenes.config import CAMERAS, KINDS, FramesConfig, SceneObjectsConfig
from pecgrasp_env.capture.scenes.frames import BIN_LABEL, FIRST_OBJECT, frames_of, read_frames, write_frames
from pecgrasp_env.capture.scenes.generate import generate_frames
from pecgrasp_env.capture.scenes.maker import SceneMaker
from pecgrasp_env.capture.scenes.object_pool import ObjectPool
from pecgrasp_env.common.job_share import JobShare

FEW = SceneObjectsConfig(plain_instances=3, catalogue_instances=1)
SMALL = FramesConfig(scenes=4, frames_per_scene=1, objects=FEW, most=4, shard_size=1, val_share=0.25, seed=3)


@pytest.fixture(scope="module")
def maker():
    return SceneMaker(SMALL)


def contents(directory: Path) -> dict[str, str]:
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


# ------------------------------------------------------------------------------------------------------------- physics


@pytest.mark.parametrize("kind", KINDS)
def test_objects_of_every_kind_rest_on_the_table_or_in_their_bin(kind):
    assert KINDS.keys() == ARRANGED.keys()
    rng = np.random.default_rng(5)
    models = ObjectPool(FEW).draw(kind, 5, rng)
    arrangement = arrange_scene(kind, models, rng)
    floor = 0.0 if arrangement.box is None else 0.006
    lowest = []
    for model, pose in zip(arrangement.models, arrangement.poses, strict=True):
        hulls = Rotation.from_quat(np.roll(pose[3:], -1)).apply(np.concatenate(model.hulls))
        lowest.append(hulls[:, 2].min() + pose[2])
    assert min(lowest) == pytest.approx(floor, abs=1e-3)


def test_stacked_things_lie_upon_others():
    pool = ObjectPool(FEW)
    raised = 0
    for seed in range(2):
        rng = np.random.default_rng(seed)
        arrangement = arrange_scene("stacked", pool.draw("stacked", 6, rng), rng)
        for model, pose in zip(arrangement.models, arrangement.poses, strict=True):
            points = Rotation.from_quat(np.roll(pose[3:], -1)).apply(np.concatenate(model.hulls))[:, 2] + pose[2]
            raised += points.min() > 0.008
    assert raised >= 2


# ------------------------------------------------------------------------------------------------------------- frames


def test_a_scene_is_the_same_whatever_was_made_before(maker):
    first = [maker.frames(scene, Counter())[0] for scene in (0, 1)]
    again = SceneMaker(SMALL).frames(1, Counter())[0]
    np.testing.assert_array_equal(first[1].depth, again.depth)
    np.testing.assert_array_equal(first[1].instance, again.instance)
    np.testing.assert_array_equal(first[1].pose, again.pose)
    assert not np.array_equal(first[0].pose, first[1].pose)


@pytest.mark.parametrize("camera", ["structured_light_640x480", "d435_424x240"])
def test_pixels_lie_on_what_their_label_says(camera):
    config = replace(SMALL, cameras={camera: 1.0}, kinds={"piled": 0.5, "apart": 0.5})
    maker, pool = SceneMaker(config), ObjectPool(FEW)
    for scene in range(2):
        frame = maker.frames(scene, Counter())[0]
        rows, columns = np.nonzero(frame.depth)
        rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]) * frame.depth[rows, columns]
        points = (frame.T_world_camera[:3, :3] @ np.linalg.inv(frame.K) @ rays).T + frame.T_world_camera[:3, 3]
        labels = frame.instance[rows, columns]
        assert np.median(np.abs(points[labels == 1, 2])) < 0.005
        assert set(np.unique(frame.instance)) <= {0, 1, BIN_LABEL, *range(FIRST_OBJECT, FIRST_OBJECT + len(frame.pose))}
        for j, (pose, number) in enumerate(zip(frame.pose, frame.class_index, strict=True)):
            on_it = points[labels == FIRST_OBJECT + j]
            if len(on_it) < 50:
                continue
            assert frame.visible[j] > 0
            inside = Rotation.from_quat(np.roll(pose[3:], -1)).inv().apply(on_it - pose[:3])
            assert np.quantile(np.linalg.norm(inside, axis=1), 0.9) < 0.2, pool.classes[number]
            away = np.linalg.norm(np.median(inside, axis=0))
            assert away < 0.15, pool.classes[number]


def test_what_is_alone_is_wholly_visible_and_what_is_behind_is_not():
    config = replace(SMALL, kinds={"bin": 1.0}, fewest=8, most=8)
    shares = np.concatenate([SceneMaker(config).frames(0, Counter())[0].visible])
    assert ((shares >= 0) & (shares <= 1)).all()
    assert (shares < 0.9).any()
    alone = SceneMaker(replace(SMALL, kinds={"apart": 1.0}, fewest=1, most=1)).frames(0, Counter())[0]
    assert alone.visible == pytest.approx([1.0], abs=0.02)


def test_a_shard_holds_what_was_written(maker, tmp_path):
    frames = maker.frames(2, Counter())
    record = write_frames(tmp_path / "shards" / "00000.npz", frames)
    (read,) = read_frames(tmp_path / record.file)
    np.testing.assert_allclose(read.depth, frames[0].depth, atol=5.1e-5)
    np.testing.assert_array_equal(read.instance, frames[0].instance)
    np.testing.assert_array_equal(read.pose, frames[0].pose)
    assert (read.kind, read.camera, read.scene, read.seed) == (frames[0].kind, frames[0].camera, 2, frames[0].seed)
    assert record.sha256 == write_frames(tmp_path / "shards" / "00001.npz", frames).sha256


# ---------------------------------------------------------------------------------------------------------- generation


def test_stopped_and_gone_on_with_or_shared_it_has_the_same_bytes(tmp_path):
    whole = generate_frames(SMALL, tmp_path / "whole", workers=1)
    assert whole.n_new == whole.n_frames == 4

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_frames(SMALL, tmp_path / "stopped", workers=1, progress=stop)
    torn = tmp_path / "stopped" / "shards" / "00000.npz"
    torn.write_bytes(torn.read_bytes()[:1000])
    assert generate_frames(SMALL, tmp_path / "stopped", workers=1).n_new == 3
    for index in (1, 0):
        generate_frames(SMALL, tmp_path / "shared", workers=1, share=JobShare(index, 2))
    assert generate_frames(SMALL, tmp_path / "shared", workers=1).n_new == 0
    reference = contents(tmp_path / "whole")
    assert contents(tmp_path / "stopped") == reference
    assert contents(tmp_path / "shared") == reference
    card = write_frames_card(tmp_path / "whole").read_text()
    assert "4 labelled frames" in card
    assert card.count("data:image/jpeg") == 4
    kept_apart = [frame.scene for frame in frames_of(tmp_path / "whole", val=True)]
    assert kept_apart == [3]
    assert len(list(frames_of(tmp_path / "whole", val=False))) == 3
    with pytest.raises(DatasetError, match=r"another data set, with config.seed=3, not 4"):
        generate_frames(replace(SMALL, seed=4), tmp_path / "whole", workers=1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kinds": {"heaped": 1.0}}, r"kinds.heaped does not exist; choose of apart"),
        ({"cameras": {"d435_1x1": 1.0}}, r"cameras.d435_1x1 does not exist"),
        ({"kinds": {"apart": 0.0}}, r"kinds: one weight at least must be above 0"),
        ({"fewest": 9, "most": 3}, r"1 ≤ fewest ≤ most"),
        ({"val_share": 1.0}, r"val_share must lie in 0 … 1"),
    ],
)
def test_what_cannot_be_made_is_said(changes, message):
    with pytest.raises(CaptureError, match=message):
        replace(SMALL, **changes)


def test_a_shard_that_is_none_is_said(tmp_path):
    (tmp_path / "x.npz").write_bytes(b"no archive")
    with pytest.raises(DatasetError, match="no shard of labelled frames"):
        list(read_frames(tmp_path / "x.npz"))


def test_meshes_of_a_folder_come_into_the_scenes(tmp_path):
    import trimesh

    (tmp_path / "lump").mkdir()
    trimesh.creation.icosphere(2, 0.04).export(tmp_path / "lump" / "a.ply")
    pool = ObjectPool(SceneObjectsConfig(path=str(tmp_path), share=1.0))
    assert pool.classes[-1] == "lump"
    assert {model.class_name for model in pool.draw("piled", 3, np.random.default_rng(0))} == {"lump"}
    assert "d435_848x480" in CAMERAS


def test_only_what_is_named_comes_into_the_scenes():
    pool = ObjectPool(replace(FEW, classes=("mouse", "box"), plain_share=0.0))
    drawn = {model.class_name for seed in range(4) for model in pool.draw("piled", 3, np.random.default_rng(seed))}
    assert drawn == {"mouse", "box"}
    with pytest.raises(CaptureError, match=r"objects.classes: 'mous' does not exist; choose of .*mouse"):
        replace(FEW, classes=("mous",))
    with pytest.raises(CaptureError, match=r"objects.plain_share must lie in 0 … 1, got 2"):
        replace(FEW, plain_share=2)


@pytest.mark.parametrize("elevations", [FROM_A_STAND, FROM_A_WRIST])
def test_a_camera_looks_down_between_two_elevations(elevations):
    rng = np.random.default_rng(0)
    target = np.array([0.1, -0.2, 0.03])
    eyes = np.array([draw_view(target, (-np.pi, np.pi), 0.45, rng, elevations)[:3, 3] for _ in range(200)]) - target
    distance = np.linalg.norm(eyes, axis=1)
    height = np.degrees(np.arcsin(eyes[:, 2] / distance))
    assert elevations[0] < height.min() < elevations[0] + 5
    assert elevations[1] - 8 < height.max() < elevations[1]
    assert 0.45 <= distance.min() <= distance.max() <= 1.4
