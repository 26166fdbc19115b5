"""One's own labelled clouds, from files to a classifier that names another file; as its user types it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from pec.data.loading import load_dataset
from pec.errors import ConfigError, DatasetError
from pecgrasp.cli import main
from pecgrasp.own_clouds import with_own_clouds

SIZES = {"ball": (0.05, 0.05, 0.05), "rod": (0.12, 0.01, 0.008)}


def shape(name: str, rng: np.random.Generator, n: int = 80) -> np.ndarray:
    """(n, 3) points of an ellipsoid's surface at a random pose, m."""
    points = rng.normal(size=(n, 3))
    points *= np.array(SIZES[name]) / np.linalg.norm(points, axis=1, keepdims=True)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return (points @ rotation.T + [0.1, -0.05, 0.5]).astype(np.float32)


def save(path: Path, points: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, points)
    elif path.suffix == ".ply":
        header = "".join(f"property float {axis}\n" for axis in "xyz")
        rows = "\n".join(" ".join(map(repr, row)) for row in points.tolist())
        path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{header}end_header\n{rows}\n")
    else:
        np.savetxt(path, points, fmt="%.9g", delimiter="," if path.suffix == ".csv" else " ")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Balls by instance, rods a file each; 12 of both in four formats."""
    rng = np.random.default_rng(0)
    suffixes = (".npy", ".ply", ".xyz", ".csv")
    for i in range(12):
        save(tmp_path / "set" / "ball" / f"ball_{i // 4}" / f"{i}{suffixes[i % 4]}", shape("ball", rng))
        save(tmp_path / "set" / "rod" / f"{i}{suffixes[i % 4]}", shape("rod", rng))
    return tmp_path / "set"


def settings(path: Path, tmp_path: Path, scale: float = 1.0) -> dict:
    return {"dataset": {"path": str(path), "scale": scale}, "cache": str(tmp_path / "cache"), "output": str(tmp_path)}


def run(command: str, *overrides: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", command, *overrides])
        main()


def test_train_compare_and_classify(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    train = ["dataset=clouds", f"path={folder}", "output=run", "protocol.epochs=2", "progress=false"]
    run("train", *train)
    said = capsys.readouterr().out
    assert "24 clouds of 15 instances (ball 12, rod 12), 80 points" in said
    results = json.loads(Path("run/results.json").read_text())
    assert set(results["best"]["test_per_class"]) == {"ball", "rod"}
    run("train", *train)  # finished: read again, not trained again
    assert json.loads(Path("run/results.json").read_text()) == results
    run("classify", str(folder / "rod" / "1.ply"), "checkpoint=run/best", "output=one")
    assert json.loads(Path("one/results.json").read_text())["label"] in ("ball", "rod", "unknown")
    run("compare", "runs=[run]", f"data={folder}", "progress=false", "output=pair")
    assert json.loads(Path("pair/results.json").read_text())["n_test"] == results["n_samples"]["test"]


def test_files_are_classes_and_folders_in_them_instances(folder, tmp_path):
    said: list[str] = []
    packed = with_own_clouds(settings(folder, tmp_path), said.append)["dataset"]
    assert set(packed) == {"path"}
    dataset = load_dataset(packed["path"])
    assert dataset.classes == ["ball", "rod"]
    assert len(np.unique(dataset.instances[dataset.labels == 0])) == 3
    assert len(np.unique(dataset.instances[dataset.labels == 1])) == 12
    stored = [np.load(path) for path in sorted((folder / "rod").glob("*.npy"))]
    assert all(any(np.array_equal(cloud, points) for cloud in dataset.clouds) for points in stored)
    assert load_dataset(with_own_clouds(settings(folder, tmp_path), said.append)["dataset"]["path"]).fingerprint == (
        dataset.fingerprint
    )


def test_a_file_that_changes_makes_other_data(folder, tmp_path):
    before = with_own_clouds(settings(folder, tmp_path), print)["dataset"]["path"]
    save(folder / "rod" / "0.npy", np.ones((80, 3)))
    assert with_own_clouds(settings(folder, tmp_path), print)["dataset"]["path"] != before


def test_what_is_left_out_is_said(folder, tmp_path):
    torn = np.load(folder / "rod" / "0.npy")
    torn[3] = np.nan
    save(folder / "rod" / "0.npy", torn)
    (folder / "rod" / "0.jpg").touch()
    save(folder / "scene.ply", torn)
    (folder / "rod" / "notes.txt").write_text("not a cloud")
    save(folder / "rod" / "9.npy", torn[:20])
    said: list[str] = []
    with_own_clouds({**settings(folder, tmp_path), "preprocess": {"n_points": 64}}, said.append)
    assert "left out: files, 1 .jpg, 1 .ply beside the classes, 1 .txt" in said
    where = f"files: 2, first {folder / 'rod' / '0.npy'}"
    assert f"left out: 2 points that are not finite or are 0, 0, 0; {where}" in said
    assert "left out: 1 clouds of fewer than 64 points" in said


@pytest.mark.parametrize("form", ["folder", "archive"])
def test_millimetres_become_metres_by_their_scale(tmp_path, form):
    rng = np.random.default_rng(1)
    clouds = [(name, 1000 * shape(name, rng)) for name in SIZES for _ in range(3)]
    own = tmp_path / "own"
    if form == "folder":
        for i, (name, points) in enumerate(clouds):
            save(own / name / f"{i}.txt", points)  # .txt is read where there is nothing else
    else:
        own = tmp_path / "own.npz"
        np.savez(own, points=np.stack([points for _, points in clouds]), labels=np.array([name for name, _ in clouds]))
    said: list[str] = []
    with_own_clouds(settings(own, tmp_path), said.append)
    assert "if these are millimetres, say dataset.scale=0.001" in said[-1]
    path = with_own_clouds(settings(own, tmp_path, scale=0.001), said.append)["dataset"]["path"]
    assert "these are millimetres" not in said[-1]
    for cloud, (_, points) in zip(load_dataset(path).clouds, clouds, strict=True):
        np.testing.assert_allclose(cloud, points / 1000, rtol=1e-5, atol=1e-7)


def test_a_file_that_cannot_be_read_is_named_with_its_row(folder, tmp_path):
    save(folder / "rod" / "0.csv", np.zeros((3, 3)))
    (folder / "rod" / "0.csv").write_text("0,1;0,2;0,3\n")
    with pytest.raises(DatasetError, match=r"rod/0\.csv: line 1: field x: '0,1' is not a number: a decimal comma"):
        with_own_clouds(settings(folder, tmp_path), print)
    (folder / "rod" / "0.csv").unlink()
    np.save(folder / "rod" / "0.npy", np.ones((4, 80, 3)))
    with pytest.raises(DatasetError, match=r"rod/0\.npy: 4 × 80 valid points: several clouds"):
        with_own_clouds(settings(folder, tmp_path), print)
    save(folder / "rod" / "0.npy", np.full((80, 3), np.nan))
    with pytest.raises(DatasetError, match=r"rod/0\.npy holds no valid point"):
        with_own_clouds(settings(folder, tmp_path), print)


def test_another_layout_is_refused_with_the_expected_one(folder, tmp_path):
    (tmp_path / "empty" / "mug").mkdir(parents=True)
    with pytest.raises(DatasetError, match=r"empty/mug holds no cloud, only nothing: expected FOLDER/<class>/"):
        with_own_clouds(settings(tmp_path / "empty", tmp_path), print)
    with pytest.raises(DatasetError, match=r"rod is no data set: expected FOLDER/<class>/"):
        with_own_clouds(settings(folder / "rod", tmp_path), print)
    with pytest.raises(ConfigError, match="the folder of the classes' folders, without a pattern"):
        with_own_clouds(settings(folder / "*" / "*.npy", tmp_path), print)
    (tmp_path / "parts").mkdir()
    for part in ("train", "test"):
        (tmp_path / "parts" / part).symlink_to(folder)
    with pytest.raises(DatasetError, match="test, train are no classes; put all into FOLDER/<class>"):
        with_own_clouds(settings(tmp_path / "parts", tmp_path), print)
    with pytest.raises(ConfigError, match=r"dataset.scale = -1 must be a positive number"):
        with_own_clouds(settings(folder, tmp_path, scale=-1), print)
    with pytest.raises(ConfigError, match=r"dataset.scale=2 is for one's own clouds, and .*nowhere"):
        with_own_clouds(settings(tmp_path / "nowhere", tmp_path, scale=2), print)


def test_a_missing_path_is_asked_for():
    with pytest.raises(SystemExit, match=r"pecgrasp train: dataset.path=… must be given"):
        run("train", "dataset=clouds")
