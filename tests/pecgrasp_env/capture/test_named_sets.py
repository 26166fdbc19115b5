"""The data sets that have a name: what is in them, where it comes from, and that the manifest says so."""

import importlib
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from scipy.spatial import cKDTree

from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, read_shard
from pec.errors import DatasetError
from pec.training.config import DatasetConfig
from pec.training.run_split import split
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, generate
from pecgrasp_env.capture.scenarios.surface import poisson_disk
from pecgrasp_env.capture.shard_plan import open_source
from pecgrasp_env.objects import ObjectError, make_object, ycb
from pecgrasp_env.objects.modelnet import ModelNetArchive, read_off

CONF = Path(__file__).parents[3] / "conf"
YCB = ["mug", "tuna_can", "controller", "bowl", "mustard_bottle"]


def configured(*overrides: str) -> CaptureConfig:
    with initialize_config_dir(str(CONF), version_base="1.3"):
        settings = compose("generate", ["out=unused", *overrides])
    return CaptureConfig.from_settings(OmegaConf.to_container(settings, resolve=True))


def test_lars_is_five_classes_of_two_objects_and_a_thousand_clouds_each():
    config = configured("dataset=lars")
    source = open_source(config)
    assert source.classes == ("joypad", "mouse", "pliers", "stapler", "plug_adapter")
    assert [len(source.names(name)) for name in source.classes] == [2] * 5
    assert (config.scenario, config.samples_per_instance) == ("free", 1000)


def test_any_number_of_instances_is_drawn_and_all_differ():
    source = open_source(configured("dataset=lars", "instances_per_class=50"))
    names = source.names("stapler")
    assert len(names) == len(set(names)) == 50
    shapes = {source.load("stapler", i).extents.tobytes() for i in range(0, 50, 7)}
    assert len(shapes) == 8


def test_ycb_is_of_look_alikes_and_the_manifest_says_so(tmp_path):
    config = configured("dataset=ycb", "samples_per_instance=2", "sensor.resolution=424x240")
    manifest = read_manifest(generate(config, tmp_path / "data", workers=1).directory)
    assert manifest.classes == YCB
    assert [instance["class"] for instance in manifest.instances] == YCB
    assert manifest.instances[1]["origin"] == "look-alike: can of the procedural catalogue"
    assert manifest.instances[1]["name"] == "can_0000"
    model = open_source(config).load("tuna_can", 0)
    assert model.class_name == "tuna_can"
    np.testing.assert_array_equal(model.extents, make_object("can", 0).extents)
    with pytest.raises(ObjectError, match="unknown object class 'drill'; the YCB set has mug"):
        open_source(configured("dataset=ycb", "objects.classes=[drill]"))


def test_ycb_of_a_mesh_folder(tmp_path):
    put = trimesh.creation.box((0.1, 0.08, 0.06))
    for name in YCB:
        (tmp_path / "own" / name).mkdir(parents=True)
        put.export(str(tmp_path / "own" / name / "scan.ply"))
    source = open_source(configured("dataset=ycb", f"objects.path={tmp_path / 'own'}"))
    assert sorted(source.classes) == sorted(YCB)
    assert source.origin("mug", 0) == "mesh scan.ply"


@pytest.fixture
def asset_folder(tmp_path) -> Path:
    """ManiSkill's data folder once its YCB download has been unpacked there, with boxes for meshes."""
    folder = tmp_path / "data"
    root = folder / "assets" / "mani_skill2_ycb"
    mesh = trimesh.creation.box((0.1, 0.08, 0.06))
    info = {}
    for name in ("002_master_chef_can", "006_mustard_bottle", "007_tuna_fish_can", "024_bowl", "025_mug"):
        (root / "models" / name).mkdir(parents=True)
        mesh.export(str(root / "models" / name / "textured.obj"))
        mesh.export(str(root / "models" / name / "collision.ply"))
        info[name] = {"bbox": {"min": [-0.05, -0.04, -0.03], "max": [0.05, 0.04, 0.03]}, "scales": [1.0]}
    (root / "info_pick_v0.json").write_text(json.dumps(info))
    return folder


def test_ycb_of_the_download(asset_folder, monkeypatch):
    monkeypatch.setattr("mani_skill.ASSET_DIR", asset_folder)
    source = open_source(configured("dataset=ycb", "objects.download=true"))
    assert source.origin("mug", 0) == "YCB mesh 025_mug"
    assert source.origin("controller", 0) == "look-alike: joypad of the procedural catalogue"
    np.testing.assert_allclose(source.load("mug", 0).extents, [0.1, 0.08, 0.06], atol=1e-6)
    assert source.load("controller", 0).class_name == "controller"


@pytest.mark.parametrize("part", ["", "assets", "assets/mani_skill2_ycb", "assets/mani_skill2_ycb/models"])
def test_ycb_of_the_folder_that_maniskill_once_downloaded(asset_folder, part):
    config = configured("dataset=ycb", f"objects.path={asset_folder / part}")
    source = open_source(config)
    assert list(source.classes) == YCB
    assert source.names("mug") == ["025_mug"]  # and no collision.ply beside it
    assert source.origin("bowl", 0) == "YCB mesh 024_bowl"
    (asset_folder / "assets/mani_skill2_ycb/models/024_bowl/textured.obj").unlink()
    with pytest.raises(ObjectError, match=r"024_bowl has no mesh .*: collision\.ply is made for collisions"):
        open_source(config)


def test_without_a_network_the_download_says_what_to_do_instead(tmp_path, monkeypatch):
    monkeypatch.setattr("mani_skill.ASSET_DIR", tmp_path)

    def unreachable(*_, **__):
        raise OSError("no route to host")

    monkeypatch.setattr(importlib.import_module("mani_skill.utils.download_asset"), "download", unreachable)
    with pytest.raises(ObjectError, match=r"no route to host.*objects\.path=FOLDER.*objects\.download=false"):
        ycb.YcbDownload()


@pytest.mark.parametrize(("name", "what"), [("folder", "a folder of meshes"), ("modelnet10", r"ModelNet10\.zip")])
def test_what_needs_a_path_says_so(name, what):
    with pytest.raises(CaptureError, match=rf"objects\.path must name {what}"):
        configured(f"dataset={name}")


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    """An archive of the official one's form: two classes, of three meshes to train and two to test, numbered through.

    In some of its files the counts follow "OFF" without a line break; and it holds what a Mac leaves in an archive.
    """
    folder = tmp_path_factory.mktemp("archive")
    for name, mesh in (
        ("bed", trimesh.creation.box((200, 150, 40))),
        ("night_stand", trimesh.creation.icosphere(2, 70)),
    ):
        for part, numbers in (("train", (1, 2, 3)), ("test", (4, 5))):
            (folder / "ModelNet10" / name / part).mkdir(parents=True)
            for i in numbers:
                text = trimesh.exchange.off.export_off(mesh)
                assert text.startswith("OFF\n")
                glued = text.replace("OFF\n", "OFF", 1) if i % 2 else text
                (folder / "ModelNet10" / name / part / f"{name}_{i:04d}.off").write_text(glued)
    path = folder / "ModelNet10.zip"
    with zipfile.ZipFile(path, "w") as packed:
        for file in sorted(folder.glob("ModelNet10/*/*/*.off")):
            packed.write(file, file.relative_to(folder))
        packed.writestr("README.txt", b"ModelNet10")
        packed.writestr("ModelNet10/.DS_Store", b"junk")
        packed.writestr("ModelNet10/bed/train/", b"")
        packed.writestr("__MACOSX/ModelNet10/bed/train/._bed_0001.off", b"junk")
    return path


def test_modelnet10_keeps_its_official_split_and_fills_the_unit_sphere(archive, tmp_path):
    config = configured("dataset=modelnet10", f"objects.path={archive}", "surface_points=200", "shard_size=4")
    made = generate(config, tmp_path / "data", workers=1)
    dataset = load_dataset(made.directory)
    assert dataset.classes == ["bed", "night_stand"]
    assert dataset.official_test.tolist() == ([False] * 3 + [True] * 2) * 2
    training, validation, test = split(dataset, DatasetConfig("", split="official"), "validation", 0)
    assert test.tolist() == [3, 4, 8, 9]
    assert sorted([*training, *validation]) == [0, 1, 2, 5, 6, 7]
    for cloud in dataset.clouds:
        assert cloud.shape == (200, 3)
        assert np.linalg.norm(cloud, axis=1).max() == pytest.approx(1, abs=1e-5)
        assert np.abs(cloud.mean(axis=0)).max() < 1e-5
    # T_camera_object leads from the file's frame and unit to the cloud's: a bed's points lie on its faces.
    record = read_manifest(made.directory).shards[0]
    shard = read_shard(made.directory / record.file)
    T = shard.T_camera_object[0].astype(float)
    on_mesh = (shard.cloud(0) - T[:3, 3]) / T[0, 0]
    assert np.abs(np.abs(on_mesh) / (100, 75, 20)).max(axis=1) == pytest.approx(np.ones(200), abs=1e-4)
    sized = load_dataset(made.directory, size="mesh").cloud(0)  # an inch for each unit of the file
    assert sized == pytest.approx(dataset.cloud(0) / T[0, 0] * 0.0254, rel=1e-5)
    unpacked = archive.parent / "ModelNet10"
    from_folder = ModelNetArchive(unpacked)
    assert from_folder.names("bed") == ModelNetArchive(archive).names("bed")
    assert from_folder.split("bed", 2) == "train"
    assert from_folder.split("bed", 3) == "test"
    assert "sensor" not in read_manifest(made.directory).config


def test_what_is_no_archive_is_named(tmp_path):
    (tmp_path / "no.zip").write_bytes(b"nothing")
    for path, message in (
        (tmp_path / "no.zip", r"no\.zip.*neither a folder nor a readable archive"),
        (tmp_path, "holds no ModelNet10"),
        (tmp_path / "missing", "neither a folder"),
    ):
        with pytest.raises(ObjectError, match=message):
            ModelNetArchive(path)


def test_off_files_are_read_with_and_without_a_line_break_and_with_polygons():
    body = b"4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    for header in (b"OFF\n", b"OFF"):
        vertices, faces = read_off(header + body + b"3 0 1 2\n3 0 2 3\n")
        assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert read_off(b"OFF\n4 1 0\n0 0 0 1 0 0 1 1 0 0 1 0\n4 0 1 2 3\n")[1].tolist() == [[0, 1, 2], [0, 2, 3]]
    for data, why in ((b"PLY", "OFF"), (b"OFF 4 2 0 1 2", "promises 4"), (b"OFF 1 1 0 0 0 0 3 0 0 7", "corner")):
        with pytest.raises(ValueError, match=why):
            read_off(data)


def test_a_broken_mesh_in_the_archive_is_named_and_can_be_skipped(archive, tmp_path):
    damaged = tmp_path / "damaged.zip"
    with zipfile.ZipFile(archive) as whole, zipfile.ZipFile(damaged, "w") as copy:
        for name in whole.namelist():
            copy.writestr(name, b"OFF 1 0 0" if name.endswith("bed_0004.off") else whole.read(name))
    config = configured("dataset=modelnet10", f"objects.path={damaged}", "surface_points=50")
    with pytest.raises(ObjectError, match=r"damaged\.zip: ModelNet10/bed/test/bed_0004\.off is not a readable"):
        generate(config, tmp_path / "data", workers=1)
    made = generate(config, tmp_path / "data", workers=1, on_error="skip")
    assert (made.n_samples, list(made.skipped)) == (9, ["bed/bed_0004"])
    assert load_dataset(made.directory).official_test.tolist() == [False] * 3 + [True] + [False] * 3 + [True] * 2


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([16, 100, 300]))
def test_poisson_disk_samples_lie_on_the_surface_and_far_from_each_other(seed, n):
    mesh = trimesh.creation.box((3.0, 2.0, 0.5))
    points = poisson_disk(mesh.vertices, mesh.faces, n, np.random.default_rng(seed))
    assert points.shape == (n, 3)
    assert np.abs(points / (1.5, 1, 0.25)).max(axis=1) == pytest.approx(np.ones(n))
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    lattice = np.sqrt(2 * mesh.area / (np.sqrt(3) * n))
    assert nearest.min() > 0.5 * lattice  # of independent points the nearest pair is a hundredth of it apart
    assert np.array_equal(points, poisson_disk(mesh.vertices, mesh.faces, n, np.random.default_rng(seed)))


def test_a_surface_without_area_gives_none():
    assert poisson_disk(np.zeros((3, 3)), np.array([[0, 1, 2]]), 8, np.random.default_rng(0)) is None


def test_training_finds_a_named_set_where_generation_leaves_it():
    with initialize_config_dir(str(CONF), version_base="1.3"):
        for name in ("robot", "lars", "ycb", "folder"):
            path = compose("train", [f"dataset={name}", "name=a"]).dataset.path
            generation = compose("generate", [f"dataset={name}", "objects.path=meshes"], return_hydra_config=True)
            HydraConfig.instance().set_config(generation)
            assert path == generation.out
    with pytest.raises(DatasetError, match="no such folder"):
        load_dataset(Path("outputs/datasets/no_such_set"))


def test_a_source_that_does_not_exist_is_named():
    with pytest.raises(CaptureError, match=r"objects\.source 'shapenet'.*modelnet10"):
        ObjectsConfig(source="shapenet")
