import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pec import Classifier
from pec.errors import CheckpointError, CloudError, ConfigError, DatasetError, ModelsError
from pec.pose import PoseRegressor
from pec.pose.checkpoint import read_pose_checkpoint
from pec.pose.clouds import load_posed_clouds
from pec.pose.distance import PoseDistance
from pec.pose.evaluation import evaluate
from pec.pose.models import PoseModels, write_models
from pec.pose.network import NetworkConfig, PoseNetwork
from pec.pose.train import train_pose
from tests.pec.pose.conftest import ORIGIN


@pytest.fixture(scope="module")
def memorised(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The checkpoint of a network that has had time to learn two dozen clouds by heart."""
    output = tmp_path_factory.mktemp("memorised")
    train_pose(
        {
            "models": str(data / "models.safetensors"),
            "output": str(output),
            "network": {"n_points": 32, "hypotheses": 2},
            "dataset": {"path": str(data), "validation_fraction": 0.5},
            "protocol": {"epochs": 150, "batch_size": 8, "learning_rate": 0.003, "weight_decay": 0.0},
            "augment": {},
            "progress": False,
        }
    )
    return output / "last"  # the best is best on the other two dozen


def test_a_few_clouds_are_learnt_by_heart(memorised, data, models):
    network = read_pose_checkpoint(memorised).network
    clouds = load_posed_clouds(data, models, 32)
    learnt = clouds.subset(torch.randperm(48, generator=torch.Generator().manual_seed(0))[24:])
    figures = evaluate(network, PoseDistance.of(models), models, learnt)["all"]
    assert figures["n"] == 24
    assert figures["nearest"]["add_10"] > 0.6  # 0 of a fresh network
    assert figures["nearest"]["add_s_2cm"] > 0.9


def test_proposals_are_poses_of_the_models_own_frame(memorised, data, models):
    regressor = PoseRegressor.load(memorised)
    assert regressor.names == models.names
    clouds = load_posed_clouds(data, models, 32)
    errors = []
    for points, truth, m in zip(clouds.points, clouds.T_camera_object, clouds.model, strict=True):
        poses, confidence = regressor.propose(points.numpy(), models.names[m])
        assert (poses.shape[1:], poses.dtype) == ((4, 4), np.float64)
        np.testing.assert_allclose(
            poses[:, :3, :3] @ poses[:, :3, :3].mT, np.tile(np.eye(3), (len(poses), 1, 1)), atol=1e-5
        )
        assert 1 <= len(poses) <= 4
        assert (np.diff(confidence) <= 0).all()
        assert 0 < confidence.sum() <= 1 + 1e-6
        there = truth[:3, :3].double().numpy() @ models.centres[m] + truth[:3, 3].double().numpy()
        errors.append(np.linalg.norm(poses[:, :3, :3] @ models.centres[m] + poses[:, :3, 3] - there, axis=1).min())
    assert np.median(errors) < 0.01  # and not off by ORIGIN
    assert np.linalg.norm(ORIGIN) > 0.03


def test_proposals_of_one_cloud_differ(memorised, data, models):
    regressor = PoseRegressor.load(memorised)
    distance = PoseDistance.of(models)
    cloud = load_posed_clouds(data, models, 32).points[1].numpy()
    poses = torch.from_numpy(regressor.propose(cloud, "can/tin", most=8).T_camera_object).float()
    k = len(poses)
    centre = poses[:, :3, :3] @ distance.centres[1] + poses[:, :3, 3]
    apart = distance(
        centre.expand(k, k, 3), poses[:, :3, :3].expand(k, k, 3, 3), poses, torch.ones(k, dtype=torch.int64)
    )
    assert (apart + torch.eye(k) > 0.15).all()


def test_a_cloud_is_answered_alike_every_time(memorised, data, models):
    regressor = PoseRegressor.load(memorised)
    cloud = load_posed_clouds(data, models, 32).points[0].numpy()
    for one, other in zip(regressor.propose(cloud, "hook/ell"), regressor.propose(cloud, "hook/ell"), strict=True):
        np.testing.assert_array_equal(one, other)


def test_bad_input_is_named(memorised):
    regressor = PoseRegressor.load(memorised)
    good = np.random.default_rng(0).normal(size=(40, 3)) * 0.02 + [0, 0, 0.5]
    with pytest.raises(ModelsError, match="no model is called 'mug/red'"):
        regressor.propose(good, "mug/red")
    with pytest.raises(CloudError, match="has only 20"):
        regressor.propose(good[:20], "can/tin")
    with pytest.raises(CloudError, match="not finite"):
        regressor.propose(np.where(np.arange(40)[:, None] == 3, np.nan, good), "can/tin")
    with pytest.raises(ConfigError, match="most must be at least 1, got 0"):
        regressor.propose(good, "can/tin", most=0)


def test_a_killed_run_ends_in_the_same_weights(settings, tmp_path, stopped_after):
    whole = train_pose(settings)
    stopped = settings | {"output": str(tmp_path / "stopped")}
    with stopped_after(2):
        train_pose(stopped)
    resumed = train_pose(stopped)
    assert resumed["curves"] == whole["curves"]
    for folder in ("last", "best"):
        one, other = (
            load_file(Path(run["checkpoint"]).parent / folder / "model.safetensors") for run in (whole, resumed)
        )
        for name, weights in one.items():
            assert torch.equal(weights, other[name]), name


def test_a_finished_run_is_not_repeated_and_another_is_refused(settings, models):
    first = train_pose(settings)
    assert train_pose(settings) == json.loads((Path(settings["output"]) / "results.json").read_text())
    assert first["n_samples"] == {"train": 43, "validation": 5}
    with pytest.raises(ConfigError, match=r"holds a run with seed=0, not 1"):
        train_pose(settings | {"seed": 1})
    changed = PoseModels(models.names, models.points * np.float32(1.1), models.symmetries, models.origins)
    path = Path(settings["output"]) / "other.safetensors"
    write_models(path, changed)
    with pytest.raises(ConfigError, match="other clouds or models"):
        train_pose(settings | {"models": str(path)})


def test_a_checkpoint_comes_back_and_a_broken_one_is_named(settings, tmp_path):
    best = Path(train_pose(settings)["checkpoint"])
    assert {path.name for path in best.iterdir()} == {"config.json", "model.safetensors", "models.safetensors"}
    config = json.loads((best / "config.json").read_text())
    assert config["models"] == ["hook/ell", "can/tin"]
    broken = tmp_path / "broken"
    shutil.copytree(best, broken)
    (broken / "config.json").write_text(json.dumps(config | {"network": config["network"] | {"hypotheses": 5}}))
    with pytest.raises(CheckpointError, match="do not fit"):
        PoseRegressor.load(broken)
    (broken / "models.safetensors").unlink()
    with pytest.raises(CheckpointError, match=r"models\.safetensors does not exist"):
        PoseRegressor.load(broken)
    with pytest.raises(CheckpointError, match="not a checkpoint's"):
        Classifier.load(best)
    with pytest.raises(CheckpointError, match="nowhere"):
        PoseRegressor.load(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"network": {"rotation": "euler"}}, "network.rotation must be one of axis_angle, quaternion, 6d, got 'euler'"),
        ({"network": {"encoder": "pec"}}, "network.encoder must be one of ordered, pointnet"),
        ({"augment": {"scale": 0.1}}, "augment.scale must be 0"),
        ({"protocol": {"batch_size": 1}}, "batch norm needs two"),
        ({"netwrok": {}}, "unknown setting netwrok"),
    ],
)
def test_senseless_settings_are_named(settings, change, message):
    with pytest.raises(ConfigError, match=message):
        train_pose(settings | change)


def test_a_model_without_clouds_is_named(settings, models, tmp_path):
    more = PoseModels(
        (*models.names, "mug/red"),
        np.concatenate([models.points, models.points[:1]]),
        (*models.symmetries, models.symmetries[0]),
        np.concatenate([models.origins, models.origins[:1]]),
    )
    write_models(tmp_path / "more.safetensors", more)
    with pytest.raises(DatasetError, match="no cloud of 'mug/red'; it has hook/ell, can/tin"):
        train_pose(settings | {"models": str(tmp_path / "more.safetensors")})


def test_a_network_is_drawn_from_the_seed():
    def fresh() -> PoseNetwork:
        torch.manual_seed(5)
        return PoseNetwork(NetworkConfig(), 3)

    one, other = fresh().state_dict(), fresh().state_dict()
    assert all(torch.equal(one[name], other[name]) for name in one)
