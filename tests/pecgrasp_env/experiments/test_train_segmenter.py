"""Training the segmenter: what it leaves is the same whatever stopped it on the way, and nothing is done twice."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pec.data.shards import Manifest, shard_name, write_manifest
from pec.errors import ConfigError
from pecgrasp_env.capture.scenes.frames import LabelledFrame, write_frames
from pecgrasp_env.experiments.kept_examples import Examples, KeptExamples
from pecgrasp_env.experiments.train_segmenter import FILE, train_segmenter

HEIGHT, WIDTH, FOCAL, FAR = 120, 160, 150.0, 0.6
FRAMES = (3, 3, 2)  # of each shard; the last of all is kept apart
READ = 4 * sum(FRAMES)  # for pairs, for pairs of parts, for groups, and to measure


class Stopped(Exception):
    """What ends a training here, as Ctrl-C does."""


def frame(number: int) -> LabelledFrame:
    """Roofs, steps and boxes that touch, on a table below the camera."""
    rng = np.random.default_rng(number)
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    height, instance = np.zeros((HEIGHT, WIDTH)), np.ones((HEIGHT, WIDTH), np.uint8)
    for label in range(2, 10):
        angle, (a, b) = rng.uniform(0, np.pi), rng.uniform(8, 24, 2)
        row, column = v - rng.uniform(15, HEIGHT - 15), u - rng.uniform(15, WIDTH - 15)
        along, across = column * np.cos(angle) + row * np.sin(angle), row * np.cos(angle) - column * np.sin(angle)
        top = rng.uniform(0.02, 0.1) + rng.choice([0.0, 0.001]) * (b - np.abs(across)) + 0.02 * (along > a / 3)
        own = (np.abs(along) < a) & (np.abs(across) < b) & (top > height)
        height[own], instance[own] = top[own], label
    depth = FAR - height + rng.normal(0, 3e-4, height.shape)
    n = 8
    return LabelledFrame(
        depth=depth.astype(np.float32),
        instance=instance,
        K=np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]),
        T_world_camera=np.eye(4),
        kind=0,
        camera=0,
        scene=number,
        seed=number,
        val=number == sum(FRAMES) - 1,
        class_index=np.zeros(n, np.int32),
        pose=np.zeros((n, 7)),
        visible=np.ones(n, np.float32),
    )


@pytest.fixture(scope="module")
def frames(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    ends = np.cumsum(FRAMES)
    shards = [
        write_frames(folder / shard_name(i, ".npz"), [frame(number) for number in range(end - n, end)])
        for i, (n, end) in enumerate(zip(FRAMES, ends, strict=True))
    ]
    about = {"kinds": ["roofs"], "cameras": ["pinhole"]}
    write_manifest(folder, Manifest(["roof"], [], [], about, 0, {"name": "test"}, shards, complete=True))
    return folder


@pytest.fixture(scope="module")
def whole(frames, tmp_path_factory) -> Path:
    """The output of a run that nothing stopped."""
    pytest.importorskip("sklearn")
    output = tmp_path_factory.mktemp("whole")
    train_segmenter([frames], output)
    return output


def stop_after(most: int):
    def progress(done: int, total: int) -> None:
        assert total == READ
        if done == most:
            raise Stopped

    return progress


@pytest.mark.slow
def test_a_run_that_was_stopped_four_times_leaves_the_same_and_repeats_nothing(frames, whole, tmp_path) -> None:
    examples = tmp_path / "examples"
    for stop, kept in (
        (4, ["pairs_00000"]),  # in the second shard
        (10, ["pairs_0", "pairs_1", "pairs_00000", "pairs_00001", "pairs_00002"]),  # in the first one's parts
        (18, ["parts_0", "parts_1", "parts_00000", "parts_00001", "parts_00002"]),  # in the first one's groups
        (25, ["all", "groups_00000", "groups_00001", "groups_00002", "parts_0", "parts_1"]),  # while it measured
    ):
        before = {path: path.stat().st_mtime_ns for path in examples.glob("*.npz")}
        with pytest.raises(Stopped):
            train_segmenter([frames], tmp_path, progress=stop_after(stop))
        assert set(kept) <= {path.stem for path in examples.glob("*.npz")}
        assert before == {path: path.stat().st_mtime_ns for path in before}
        assert not (tmp_path / "results.json").exists()
    seen: list[int] = []
    train_segmenter([frames], tmp_path, progress=lambda done, _: seen.append(done))
    assert seen == list(range(3 * sum(FRAMES) + 1, READ + 1))  # no frame was cut again
    for name in (FILE, "results.json"):
        assert (tmp_path / name).read_bytes() == (whole / name).read_bytes()
    assert not examples.exists()


@pytest.mark.slow
def test_a_share_that_is_gone_or_damaged_is_made_again(frames, whole, tmp_path) -> None:
    with pytest.raises(Stopped):
        train_segmenter([frames], tmp_path, progress=stop_after(25))
    (tmp_path / "examples" / "pairs_00001.npz").unlink()
    (tmp_path / "examples" / "groups_00000.npz").write_bytes(b"nothing")
    (tmp_path / "examples" / "all.npz").unlink()
    train_segmenter([frames], tmp_path)
    assert (tmp_path / FILE).read_bytes() == (whole / FILE).read_bytes()


def test_a_finished_run_is_not_repeated_and_another_is_refused(frames, whole) -> None:
    calls: list[int] = []
    before = (whole / FILE).stat().st_mtime_ns
    results = train_segmenter([frames], whole, progress=lambda done, _: calls.append(done))
    assert results["frames"] == sum(FRAMES)
    assert not calls
    assert (whole / FILE).stat().st_mtime_ns == before
    with pytest.raises(ConfigError, match=r"seed=0, not 1: choose another output, or delete it"):
        train_segmenter([frames], whole, seed=1)
    with pytest.raises(ConfigError, match=r"val=None"):
        train_segmenter([frames], whole, val=frames)


def test_what_other_settings_or_data_began_is_refused(frames, tmp_path) -> None:
    output = tmp_path / "output"
    with pytest.raises(Stopped):
        train_segmenter([frames], output, progress=stop_after(4))
    with pytest.raises(ConfigError, match=r"seed=0, not 1: choose another output, or delete it"):
        train_segmenter([frames], output, seed=1, progress=stop_after(4))
    changed = tmp_path / "changed"
    shutil.copytree(frames, changed)
    record = write_frames(changed / shard_name(0, ".npz"), [frame(100)])
    about = {"kinds": ["roofs"], "cameras": ["pinhole"]}
    write_manifest(changed, Manifest(["roof"], [], [], about, 0, {"name": "test"}, [record], complete=True))
    with pytest.raises(ConfigError, match="data="):
        train_segmenter([changed], output)


def test_examples_are_kept_as_they_were_made(tmp_path) -> None:
    some = Examples()
    some.add(np.float32([[1, np.nan], [2, 3]]), np.array([True, False]), np.array([0.5, 0.0]))
    kept = KeptExamples.of_run(tmp_path, {"seed": 0})
    made = kept.examples("pairs_00000", lambda: {"near": some, "far": Examples()})
    read = kept.examples("pairs_00000", dict)
    assert "pairs_00000" in kept
    assert read.keys() == made.keys() == {"near", "far"}
    for before, now in zip(made["near"].arrays(), read["near"].arrays(), strict=True):
        np.testing.assert_array_equal(before, now)
        assert before.dtype == now.dtype
    assert not read["far"].features
