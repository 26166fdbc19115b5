"""Work that is shared, cut off or disturbed: jobs, kill -9, a full disk, objects that cannot be captured."""

import errno
import hashlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, read_shard, write_manifest
from pec.errors import DatasetError
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, generate
from pecgrasp_env.common.job_share import JobShare, JobShareError
from pecgrasp_env.objects import ObjectError

ROOT = Path(__file__).parents[3]
SMALL = CaptureConfig(
    objects=ObjectsConfig(classes=("can", "plug_adapter"), instances_per_class=2),
    samples_per_instance=12,
    shard_size=3,
    seed=7,
)
# Children that have imported everything already and are killed for it by the dozen.
FORKED = multiprocessing.get_context("forkserver")
FORKED.set_forkserver_preload(["pecgrasp_env.capture.scenarios.free", "pecgrasp_env.capture.workers"])


def contents(directory: Path) -> dict[str, str]:
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Path:
    """The small data set, made in one go by one process."""
    return generate(SMALL, tmp_path_factory.mktemp("reference") / "data", workers=1).directory


# Cut off


def test_killed_five_times_and_gone_on_with_it_has_the_same_bytes(reference, tmp_path):
    directory = tmp_path / "data"
    rng = np.random.default_rng(0)
    deadline = time.monotonic() + 120

    def run():
        process = FORKED.Process(target=generate, args=(SMALL, directory), kwargs={"workers": 1})
        process.start()
        return process

    def shards() -> int:
        return len(list(directory.glob("shards/*.safetensors")))

    for _ in range(5):
        before, process = shards(), run()
        while shards() < before + 2 and process.is_alive():
            assert time.monotonic() < deadline
            time.sleep(0.001)
        time.sleep(float(rng.uniform(0, 0.02)))  # wherever it is then
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    assert not read_manifest(directory).complete
    process = run()
    process.join()
    assert process.exitcode == 0
    assert {name: digest for name, digest in contents(directory).items() if ".tmp" not in name} == contents(reference)


def test_kill_minus_nine_leaves_no_process(tmp_path):
    config = replace(SMALL, samples_per_instance=600, sensor="d435")
    process = FORKED.Process(target=generate, args=(config, tmp_path / "data"), kwargs={"workers": 2})
    process.start()
    deadline = time.monotonic() + 60
    while not (tmp_path / "data/manifest.json").exists():
        assert process.is_alive(), "ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    workers = children(process.pid)
    assert len(workers) >= 2
    process.kill()
    process.join()
    kept = read_manifest(tmp_path / "data")
    assert not kept.complete
    assert kept.shards
    for record in kept.shards:
        read_shard(tmp_path / "data" / record.file, record)
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < deadline, "a worker outlived its parent"
        time.sleep(0.05)


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


# Shared


def test_parts_of_three_jobs_merge_into_the_bytes_of_one_run(reference, tmp_path):
    directory = tmp_path / "data"
    made = [generate(SMALL, directory, workers=1, share=JobShare(i, 3)) for i in (2, 0, 1)]
    assert sum(part.n_new for part in made) == 48
    assert [part.n_samples for part in made] == [18, 15, 15]
    assert sorted(path.name for path in directory.glob("*.json")) == [f"manifest.{i}of3.json" for i in range(3)]
    with pytest.raises(DatasetError, match=r"manifest\.json does not exist.*same command without shard="):
        load_dataset(directory)
    merged = generate(SMALL, directory, workers=1)
    assert (merged.n_new, merged.n_samples) == (0, 48)
    assert contents(directory) == contents(reference)


def test_a_merge_makes_what_a_dead_job_left_out_and_a_job_goes_on(reference, tmp_path):
    directory = tmp_path / "data"
    generate(SMALL, directory, workers=1, share=JobShare(0, 2))
    generate(SMALL, directory, workers=1, share=JobShare(1, 2))
    (directory / "manifest.1of2.json").unlink()
    (directory / "shards/00002.safetensors").write_bytes(b"damaged")
    assert generate(SMALL, directory, workers=1, share=JobShare(0, 2)).n_new == 3
    assert generate(SMALL, directory, workers=1, share=JobShare(0, 2)).n_new == 0
    assert generate(SMALL, directory, workers=1).n_new == 24
    assert contents(directory) == contents(reference)


def test_a_part_of_another_data_set_is_not_merged(tmp_path):
    generate(replace(SMALL, seed=8), tmp_path / "data", workers=1, share=JobShare(0, 8))
    with pytest.raises(DatasetError, match=r"manifest\.0of8\.json is of another data set, with config\.seed=8, not"):
        generate(SMALL, tmp_path / "data", workers=1)


@pytest.mark.parametrize("text", ["8/8", "1", "-1/3", "a/b", "0/0", "1/2/3"])
def test_parts_that_do_not_exist_are_refused(text):
    with pytest.raises(JobShareError, match=r"must be i/n with 0 ≤ i < n"):
        JobShare.parse(text)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("launcher", "plugin", "jobs"),
    [("joblib", "hydra_joblib_launcher", 2), ("submitit_local", "hydra_submitit_launcher", 4)],
)
def test_a_launcher_shares_the_work_and_the_plain_command_merges(tmp_path, launcher, plugin, jobs):
    pytest.importorskip(f"hydra_plugins.{plugin}")
    parts = ",".join(f"{i}/{jobs}" for i in range(jobs))
    settings = ["objects.classes=[can,plug_adapter]", "samples_per_instance=6", "shard_size=3"]
    settings += ["instances_per_class=2", "workers=1", "progress=false", "sensor.resolution=424x240"]

    def run(out: Path, *more: str) -> Path:
        script = [sys.executable, str(ROOT / "scripts/generate_dataset.py"), *more, f"out={out}", *settings]
        done = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True)  # jobs leave their logs there
        assert done.returncode == 0, done.stderr
        return out

    shared = run(tmp_path / "shared", "-m", f"shard={parts}", f"hydra/launcher={launcher}")
    assert len(list(shared.glob("results.*of*.json"))) == len(list(shared.glob("manifest.*of*.json"))) == jobs
    assert not (shared / "manifest.json").exists()
    run(shared)
    assert json.loads((shared / "results.json").read_text())["new_clouds"] == 0
    merged_set = load_dataset(shared)
    assert merged_set.classes == ["can", "plug_adapter", "unknown"]
    assert np.bincount(merged_set.labels).tolist() == [12, 12, 12]  # strangers are a third of all
    alone = contents(run(tmp_path / "alone"))
    data = [name for name in alone if name.startswith(("manifest", "splits", "card", "shards"))]
    assert len(data) == 3 + 8 + 6  # and six shards of strangers
    merged = contents(shared)
    assert {name: merged[name] for name in data} == {name: alone[name] for name in data}


# Disturbed


@pytest.mark.parametrize("file", ["shards/00003.safetensors", "manifest.json", "splits.json"])
def test_a_full_disk_is_named_and_the_same_call_goes_on(reference, tmp_path, monkeypatch, file):
    directory = tmp_path / "data"
    write_bytes = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        return write_bytes(path if path.name != Path(file).name else Path("/dev/full"), data)

    monkeypatch.setattr(Path, "write_bytes", full)  # what is written there meets a full disk
    with pytest.raises(
        CaptureError, match=rf"disk is full: .*{file} could not.*Free some space.*same command goes on"
    ) as e:
        generate(SMALL, directory, workers=1)
    assert isinstance(e.value.__cause__, OSError)
    assert e.value.__cause__.errno == errno.ENOSPC
    assert not list(directory.rglob("*.tmp"))
    monkeypatch.undo()
    generate(SMALL, directory, workers=1)
    assert contents(directory) == contents(reference)


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> Path:
    """One class that can be captured, and in another one mesh that can and three that cannot."""
    folder = tmp_path_factory.mktemp("meshes")
    brick = trimesh.creation.box((0.1, 0.06, 0.04))
    for name, mesh in (
        ("brick/a.ply", brick),
        ("brick/b.ply", trimesh.creation.box((0.12, 0.05, 0.03))),
        ("thing/fine.ply", trimesh.creation.box((0.05, 0.05, 0.05))),
        ("thing/millimetres.stl", brick.copy().apply_scale(1000)),
    ):
        (folder / name).parent.mkdir(exist_ok=True)
        mesh.export(str(folder / name))
    (folder / "thing" / "broken.obj").write_text("v 1 2\nf nonsense")
    return folder


def of_folder(meshes: Path, **changes) -> CaptureConfig:
    return replace(SMALL, objects=ObjectsConfig(path=str(meshes)), samples_per_instance=4, **changes)


@pytest.mark.parametrize("scenario", ["free", "tabletop"])
def test_objects_that_cannot_be_captured_stop_or_are_skipped(meshes, tmp_path, scenario):
    config = of_folder(meshes, scenario=scenario)
    with pytest.raises(ObjectError, match=r"broken\.obj|millimetres\.stl.*on_error=skip goes on"):
        generate(config, tmp_path / "data", workers=1)
    made = generate(config, tmp_path / "data", workers=1, on_error="skip")
    assert set(made.skipped) == {"thing/broken", "thing/millimetres"}
    assert "objects.scale=0.001" in made.skipped["thing/millimetres"]
    assert "broken.obj" in made.skipped["thing/broken"]
    dataset = load_dataset(tmp_path / "data")
    assert np.bincount(dataset.labels).tolist() == [8, 4]
    names = [instance["name"] for instance in read_manifest(tmp_path / "data").instances]
    assert [names[i] for i in np.unique(dataset.instances)] == ["a", "b", "fine"]
    assert generate(config, tmp_path / "data", workers=1, on_error="skip").n_new == 0
    with pytest.raises(ObjectError, match=r"broken|millimetres"):  # whoever does not skip wants them all
        generate(config, tmp_path / "data", workers=1)


def test_a_skipped_mesh_that_was_mended_is_captured_without_touching_the_others(meshes, tmp_path):
    import shutil

    folder = shutil.copytree(meshes, tmp_path / "meshes")
    (folder / "thing" / "millimetres.stl").unlink()
    trimesh.creation.box((0.07, 0.03, 0.03)).export(str(folder / "thing" / "broken.stl"))
    (folder / "thing" / "broken.obj").rename(tmp_path / "kept.obj")
    whole = generate(of_folder(folder), tmp_path / "whole", workers=1).directory
    (folder / "thing" / "broken.stl").rename(tmp_path / "kept.stl")
    (folder / "thing" / "broken.stl").write_bytes(b"")
    assert generate(of_folder(folder), tmp_path / "data", workers=1, on_error="skip").n_samples == 12
    (tmp_path / "kept.stl").replace(folder / "thing" / "broken.stl")
    assert generate(of_folder(folder), tmp_path / "data", workers=1).n_new == 4
    assert contents(tmp_path / "data") == contents(whole)


def test_on_error_is_stop_or_skip(tmp_path):
    with pytest.raises(CaptureError, match="on_error must be stop or skip, got 'ignore'"):
        generate(SMALL, tmp_path, on_error="ignore")


def test_clouds_of_a_mesh_that_changed_are_not_mixed(reference, tmp_path):
    made = generate(SMALL, tmp_path / "data", workers=1).directory
    manifest = read_manifest(made)
    manifest.instances[1]["mesh_sha256"] = "of another mesh"
    write_manifest(made, manifest)
    (made / "shards/00005.safetensors").unlink()
    with pytest.raises(DatasetError, match="another can_0001: its mesh has changed"):
        generate(SMALL, made, workers=1)


def test_every_split_of_a_generated_set_is_stored_and_disjoint(reference):
    dataset = load_dataset(reference)
    assert set(dataset.test) == {"sample", "instance"}
    assert [int(dataset.test["sample"][dataset.instances == i].sum()) for i in range(4)] == [3, 3, 3, 3]
    of_test = set(dataset.instances[dataset.test["instance"]].tolist())
    assert len(of_test) == 2
    assert not of_test & set(dataset.instances[~dataset.test["instance"]].tolist())
    assert os.path.getsize(reference / "splits.json") < 1000
