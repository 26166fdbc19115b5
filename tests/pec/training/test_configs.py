"""Every group of conf/ that trains composes to settings that training accepts."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pec.training.config import TrainConfig, read_config
from pecgrasp.own_clouds import with_own_clouds

CONF = Path(__file__).parents[3] / "conf"


def _names(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def _config(*overrides: str) -> TrainConfig:
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", ["dataset.path=somewhere", "name=a", *overrides])
    settings = OmegaConf.to_container(cfg, resolve=True)
    del settings["name"]
    return read_config(with_own_clouds(settings))  # which takes what is its own


@pytest.mark.parametrize("group", ["dataset", "preprocess", "model", "protocol", "augment"])
def test_every_choice_is_accepted(group):
    assert _names(group)
    for name in _names(group):
        _config(f"{group}={name}")


def test_published_settings_are_the_published_ones():
    config = _config("preprocess=published_g8", "protocol=published", "augment=none")
    assert (config.preprocess.ordering, config.preprocess.group_size, config.preprocess.n_points) == ("groups", 8, 64)
    assert (config.preprocess.start, config.preprocess.pose, config.preprocess.n_candidates) == ("random", "given", 64)
    protocol = config.protocol
    assert (protocol.epochs, protocol.learning_rate, protocol.batch_size) == (150, 0.01, None)
    assert (protocol.schedule, protocol.weight_decay, protocol.label_smoothing) == ("constant", 0, 0)
    assert protocol.selection == "evaluation split"
    assert config.augment.is_identity
    assert _config("preprocess=none").preprocess.ordering == "none"


def test_command_line_defaults_are_the_library_defaults():
    from_files = _config()
    from_code = read_config({"dataset": {"path": "somewhere"}, "output": from_files.output})
    assert from_files.decisive() == from_code.decisive()


@pytest.mark.parametrize("name", ["table_4_1", "table_4_2", "table_4_3", "learning_rates", "rivals"])
def test_every_cell_of_an_experiment_is_accepted(name):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        base = [f"experiment={name}", "dataset.path=somewhere", "name=a", "folder=b"]
        cfg = compose("ablate", base, return_hydra_config=True)
        title = cfg.table.title
        grid = {key: str(value).split(",") for key, value in cfg.hydra.sweeper.params.items()}
        # Every value of each axis once: the axes do not depend on each other.
        for i in range(max(map(len, grid.values()))):
            cell = [f"{key}={values[i % len(values)]}" for key, values in grid.items()]
            settings = OmegaConf.to_container(compose("ablate", [*base, *cell]), resolve=True)
            published = settings.pop("table")["published"]
            del settings["name"], settings["folder"]
            config = read_config(settings)
            assert config.augment.is_identity == (name != "rivals")
    if name.startswith("table"):
        assert title.startswith(f"Table {name[-3]}.{name[-1]}")
        assert {"published_g16", "published_n128_g32", "none"} <= set(grid["preprocess"])
        assert len(grid["seed"]) >= 3
        assert all(70 - 5 < item["accuracy"] < 100 for item in published)
