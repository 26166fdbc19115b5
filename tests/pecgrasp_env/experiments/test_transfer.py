"""The transfer table: test clouds come out of the environment and are labelled right; the table goes on."""

import json
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pec.data.loading import load_dataset
from pec.data.shards import read_manifest, read_shard
from pec.errors import DatasetError
from pecgrasp_env.experiments.scene_clouds import capture_scenes
from pecgrasp_env.experiments.transfer import cluster_interval, run_transfer, table
from pecgrasp_env.objects import make_object

CONF = Path(__file__).parents[3] / "conf"


def configured(*overrides):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return OmegaConf.to_container(compose("transfer", list(overrides)), resolve=True)


SCENES = configured("scenes.scenes=2")["scenes"]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    return capture_scenes(SCENES, tmp_path_factory.mktemp("scenes") / "data")


def test_scene_clouds_are_of_unseen_objects_and_labelled_right(scenes):
    manifest = read_manifest(scenes)
    clouds, views = 0, set()
    for record in manifest.shards:
        shard = read_shard(scenes / record.file, record)
        assert len(set(shard.instance_index.tolist())) == 3
        for i in range(len(shard)):
            instance = manifest.instances[shard.instance_index[i]]
            number = int(instance["name"].rpartition("_")[2])
            assert 6000 <= number < 6020  # training draws 0 to 19
            assert manifest.classes[shard.class_index[i]] == instance["class"]
            vertices = make_object(instance["class"], number).visual_mesh().vertices
            T = shard.T_camera_object[i].astype(float)
            local = (shard.cloud(i) - T[:3, 3]) @ T[:3, :3]
            margin = 0.008  # the sensor's noise
            inside = np.all((local > vertices.min(0) - margin) & (local < vertices.max(0) + margin), axis=1)
            assert inside.mean() > 0.9
            assert len(local) >= 64
            clouds += 1
            views.add((int(shard.seed[i]), int(shard.camera[i]), int(shard.instance_index[i])))
    # Two scenes, three objects, four views; some are cut off by the image, some come in pieces, as for the robot.
    assert 12 <= len(views) <= 24
    assert len(views) <= clouds < 1.5 * len(views)
    shown = {manifest.instances[instance]["class"] for _, _, instance in views}  # two scenes need not have all classes
    assert len(load_dataset(scenes, sorted(shown))) == clouds


def test_scenes_are_gone_on_with_and_others_are_refused(scenes, tmp_path):
    told = []
    part = capture_scenes({**SCENES, "scenes": 1}, tmp_path / "data")
    first = read_manifest(part).shards[0]
    assert first == read_manifest(scenes).shards[0]  # the same scene, the same bytes
    capture_scenes({**SCENES, "scenes": 1}, tmp_path / "data", lambda *done: told.append(done))
    assert not told
    with pytest.raises(DatasetError, match="clouds of other scenes"):
        capture_scenes({**SCENES, "sensor": "ideal"}, tmp_path / "data")


def test_an_interval_over_objects_is_wider_than_one_over_their_clouds():
    clusters = np.repeat(np.arange(20), 50)
    right = np.repeat(np.arange(20) < 15, 50)  # of each object all are right, or all wrong
    low, high = cluster_interval(right, clusters)
    assert low < 0.75 < high
    assert high - low > 0.3
    narrow = cluster_interval(right, np.arange(1000))
    assert narrow[1] - narrow[0] < 0.07
    assert cluster_interval(np.ones(10), np.arange(10)) == (1, 1)


def test_the_configuration_names_every_recipe():
    settings = configured()
    assert settings["scenarios"] == ["free", "tabletop"]
    assert settings["sensors"] == ["ideal", "d435"]
    assert list(settings["augments"]) == ["none", "defects"]
    assert settings["augments"]["defects"]["remove"] == 0.4
    assert list(settings["models"]) == ["pec", "pec2"]
    assert len(settings["seeds"]) >= 3
    trained = range(settings["generation"]["instances_per_class"])
    tested = settings["scenes"]["objects"]
    assert tested["seed"] > trained[-1]


@pytest.mark.slow
def test_the_table_goes_on_where_it_was_stopped(tmp_path):
    small = [f"out={tmp_path}", "scenes.scenes=8", "generation.instances_per_class=2", "workers=1", "seeds=[0]"]
    small += ["generation.samples_per_instance=12", "training.protocol.epochs=1", "training.progress=false"]
    small += ["~models.pec2", "sensors=[d435]", "~augments.none"]
    results = run_transfer(configured(*small), lambda line: None)
    assert [(row["scenario"], row["sensor"], row["defects"]) for row in results["recipes"]] == [
        ("free", "d435", "defects"),
        ("tabletop", "d435", "defects"),
    ]
    for row in results["recipes"]:
        assert row["interval"][0] <= row["accuracy"] <= row["interval"][1]
    assert json.loads((tmp_path / "results.json").read_text()) == json.loads(json.dumps(results))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.name != "results.json"}
    assert run_transfer(configured(*small), lambda line: None) == results
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.name != "results.json"}
    assert "free" in table(results)
