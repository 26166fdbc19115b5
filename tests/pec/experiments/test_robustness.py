"""Corruptions do what their names say, as strongly as their level; the table says what the classifiers made of them."""

import json
import subprocess
import sys
from pathlib import Path
from statistics import fmean

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pec.data.corruptions import (
    ADD_GLOBAL,
    ADD_LOCAL,
    CORRUPTIONS,
    DROP_GLOBAL,
    DROP_LOCAL,
    JITTER,
    LEVELS,
    ROTATE,
    corrupt,
)
from pec.errors import CheckpointError, ConfigError
from pec.experiments.robustness import measure_robustness, robustness_table
from pec.training.loop import train

ROOT = Path(__file__).parents[3]


def _cloud(n: int = 1024, seed: int = 0) -> np.ndarray:
    """Points on an ellipsoid of half a metre, a metre before the camera."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return (points * [0.25, 0.1, 0.05] + [0.2, -0.1, 1.0]).astype(np.float32)


def _radius(points: np.ndarray) -> float:
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())


@given(st.sampled_from(sorted(CORRUPTIONS)), st.sampled_from(LEVELS), st.integers(64, 400), st.integers(0, 2**32))
def test_any_cloud_keeps_its_place_its_size_and_enough_points(kind, level, n, seed):
    cloud = _cloud(n, seed)
    changed = corrupt(cloud, kind, level, np.random.default_rng(seed), least=64)
    assert changed.dtype == np.float32
    assert changed.shape[0] >= 64
    assert np.isfinite(changed).all()
    # Jitter of five per cent of the radius can carry a point out by some standard deviations.
    assert np.linalg.norm(changed - cloud.mean(axis=0), axis=1).max() < 1.4 * _radius(cloud)
    again = corrupt(cloud, kind, level, np.random.default_rng(seed), least=64)
    assert np.array_equal(changed, again)


@pytest.mark.parametrize("level", LEVELS)
def test_counts_are_those_of_the_level(level):
    cloud, rng = _cloud(), np.random.default_rng(1)
    n = {kind: len(corrupt(cloud, kind, level, rng)) for kind in CORRUPTIONS}
    assert n["scale"] == n["jitter"] == n["rotate"] == 1024
    assert n["drop-global"] == int(1024 * (1 - DROP_GLOBAL[level - 1]))
    assert n["drop-local"] == 1024 - 100 * level == 1024 - round(1024 * DROP_LOCAL[level - 1])
    assert n["add-global"] == 1024 + 10 * level == 1024 + round(1024 * ADD_GLOBAL[level - 1])
    assert n["add-local"] == 1024 + 100 * level == 1024 + round(1024 * ADD_LOCAL[level - 1])


def test_dropped_and_added_points_leave_the_others_alone():
    cloud, rng = _cloud(), np.random.default_rng(2)
    for kind in ("drop-global", "drop-local"):
        kept = corrupt(cloud, kind, 3, rng)
        assert np.abs(kept[:, None] - cloud).max(axis=2).min(axis=1).max() < 1e-6
    for kind in ("add-global", "add-local"):
        assert np.allclose(corrupt(cloud, kind, 3, rng)[:1024], cloud, atol=1e-6)


def test_drop_local_leaves_holes_and_drop_global_does_not():
    cloud = _cloud()

    def farthest_gap(kind: str) -> float:
        """Of the points that are gone, the greatest distance to one that is left."""
        gaps = []
        for seed in range(10):
            kept = corrupt(cloud, kind, 3, np.random.default_rng(seed))
            gaps.append(np.linalg.norm(cloud[:, None] - kept, axis=2).min(axis=1).max())
        return fmean(gaps)

    assert farthest_gap("drop-local") > 1.5 * farthest_gap("drop-global")


@pytest.mark.parametrize("level", [1, 5])
def test_jitter_and_rotation_are_as_strong_as_their_level(level):
    cloud = _cloud()
    centred = cloud - cloud.mean(axis=0)
    offset = corrupt(cloud, "jitter", level, np.random.default_rng(0)) - cloud
    assert offset.std() / _radius(cloud) == pytest.approx(JITTER[level - 1], rel=0.1)
    angles = []
    for seed in range(50):
        turned = corrupt(cloud, "rotate", level, np.random.default_rng(seed))
        turned = turned - turned.mean(axis=0)
        assert np.allclose(np.linalg.norm(turned, axis=1), np.linalg.norm(centred, axis=1), atol=1e-5)
        u, _, vt = np.linalg.svd(centred.astype(float).T @ turned)
        angles.append(np.degrees(np.arccos(np.clip((np.trace(u @ vt) - 1) / 2, -1, 1))))
    assert 0.4 * ROTATE[level - 1] < max(angles) < 3**0.5 * 1.1 * ROTATE[level - 1]


def test_scale_changes_proportions_and_not_the_size():
    cloud = _cloud()
    stretched = corrupt(cloud, "scale", 5, np.random.default_rng(3))
    assert _radius(stretched) == pytest.approx(_radius(cloud), rel=0.05)
    ratio = np.ptp(stretched, axis=0) / np.ptp(cloud, axis=0)
    assert ratio.max() / ratio.min() > 1.1


def test_what_there_is_not_is_an_error():
    with pytest.raises(ConfigError, match="got 'rain'"):
        corrupt(_cloud(), "rain", 1, np.random.default_rng(0))
    with pytest.raises(ConfigError, match="1 to 5, got 6"):
        corrupt(_cloud(), "jitter", 6, np.random.default_rng(0))


@pytest.fixture(scope="module")
def runs(shapes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    settings = {"dataset": {"path": str(shapes)}, "augment": {}, "progress": False}
    settings |= {"protocol": {"epochs": 1, "batch_size": 32}}
    for name, model, size, seed in (
        ("knn_0", "knn", "kept", 0),
        ("knn_1", "knn", "kept", 1),
        ("pec", "pec", "unit", 0),
        ("pec_kept", "pec", "kept", 0),
    ):
        of_run = {"model": {"name": model}, "preprocess": {"ordering": "none", "size": size}, "seed": seed}
        train(settings | of_run | {"output": str(folder / name)})
    return folder


def test_rows_are_the_runs_by_their_own_test_split(runs):
    rows = measure_robustness([runs / name for name in ("knn_0", "knn_1", "pec", "pec_kept")])
    assert [(row["network"], row["seed"], row["n_test"]) for row in rows] == [
        ("knn", 0, 30),
        ("knn", 1, 30),
        ("pec", 0, 30),
        ("pec", 0, 30),
    ]
    for row in rows:
        results = json.loads((Path(row["run"]) / "results.json").read_text())
        # FPS starts at another point here: nearly the same clouds.
        assert row["clean"] == pytest.approx(results["best"]["test_accuracy"], abs=0.1)
        assert all(len(row[kind]) == len(LEVELS) for kind in CORRUPTIONS)
    # Shape distributions do not change in a rotation, and do when it is stretched.
    assert min(rows[0]["rotate"]) > rows[0]["clean"] - 0.1
    assert rows[0]["scale"][4] < rows[0]["clean"]
    assert measure_robustness([runs / "knn_1"]) == [rows[1]]

    lines = robustness_table(rows).splitlines()
    assert lines[0].split(" | ")[:6] == ["model", "points", "order", "seeds", "clean", "scale"]
    # Seeds share a line, other preprocessing does not.
    assert [line.split(" | ")[:4] for line in lines[2:5]] == [
        ["knn", "64", "no grouping", "2"],
        ["pec", "64", "no grouping, unit size", "1"],
        ["pec", "64", "no grouping", "1"],
    ]
    assert lines[3].split(" | ")[5] == f"{100 * fmean(rows[2]['scale']):.1f}"
    assert " ± " in lines[2]
    assert " ± " not in lines[3]


@pytest.mark.slow
def test_script_prints_the_table_and_leaves_the_numbers(runs, shapes, tmp_path):
    command = [sys.executable, str(ROOT / "scripts" / "robustness.py"), f"runs={runs / 'knn_0'}", "progress=false"]
    done = subprocess.run(
        [*command, f"data={shapes}", f"output={tmp_path}"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "table.md").read_text() in done.stdout
    assert len(json.loads((tmp_path / "results.json").read_text())["rows"]) == 1


def test_folder_without_a_finished_run_is_an_error(tmp_path):
    with pytest.raises(CheckpointError, match="holds no finished training run"):
        measure_robustness([tmp_path])
    (tmp_path / "results.json").write_text('{"rows": []}')  # a table's
    with pytest.raises(CheckpointError, match="something else than a training run"):
        measure_robustness([tmp_path])
