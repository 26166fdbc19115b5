"""What a data set is made of: the defaults, the configurations that are shipped, and those that make no sense."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pecgrasp.cli import main
from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, TabletopConfig
from pecgrasp_env.objects import CLASSES, LARS_CLASSES
from pecgrasp_env.sensor import SensorError
from pecgrasp_env.sensor.structured_light_noise import StructuredLightNoise

ROOT = Path(__file__).parents[3]


LARS = CaptureConfig(objects=ObjectsConfig(instances_per_class=2), resolutions=("848x480",))
WITH_STRANGERS = ObjectsConfig(strangers=None)
WIDE = replace(WITH_STRANGERS, families="wide")
ROBOT = CaptureConfig(
    scenario="tabletop", objects=WIDE, sensor="d435", samples_per_instance=100, resolutions=("424x240",)
)


@pytest.mark.parametrize(
    ("overrides", "config"),
    [
        ([], ROBOT),
        (["dataset=robot"], ROBOT),
        (
            ["dataset=folder", "objects.path=M"],
            replace(ROBOT, objects=replace(WITH_STRANGERS, source="folder", path="M")),
        ),
        (["objects.path=M"], replace(ROBOT, objects=replace(WITH_STRANGERS, path="M"))),
        (
            ["objects=catalogue"],
            replace(ROBOT, objects=replace(WIDE, classes=CLASSES, instances_per_class=10)),
        ),
        (["objects.strangers=0"], replace(ROBOT, objects=ObjectsConfig(families="wide"))),
        (["objects.families=narrow"], replace(ROBOT, objects=WITH_STRANGERS)),
        (["scenario=surface"], replace(ROBOT, scenario="surface", objects=ObjectsConfig(families="wide"))),
        (["scenario=free", "sensor.mode=ideal"], replace(ROBOT, scenario="free", sensor="ideal")),
        (["dataset=lars"], LARS),
        (["dataset=lars", "sensor=d435"], replace(LARS, sensor="d435")),
        (["dataset=lars", "scenario=tabletop", "sensor=d435"], replace(LARS, scenario="tabletop", sensor="d435")),
        (
            ["sensor=structured_light", "tabletop.losses=true"],
            replace(
                ROBOT,
                sensor="structured_light",
                resolutions=("640x480",),
                noise=StructuredLightNoise(),
                tabletop=TabletopConfig(losses=True),
            ),
        ),
        (
            ["sensor=structured_light", "sensor.mode=ideal"],
            replace(ROBOT, sensor="ideal", resolutions=("640x480",)),
        ),
        (["dataset=ycb"], replace(LARS, objects=ObjectsConfig("ycb"))),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_the_configurations_that_are_shipped(overrides, config):
    """The default is what the robot sees, the published sets are as published; sizes are the code's own defaults."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        settings = compose("generate", ["out=unused", *overrides])
    assert CaptureConfig.from_settings(OmegaConf.to_container(settings, resolve=True)) == config


def test_the_published_set_has_five_classes_and_a_thousand_clouds_an_object():
    assert LARS.samples_per_instance == 1000
    assert (LARS.scenario, LARS.sensor, len(LARS_CLASSES)) == ("free", "ideal", 5)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"samples_per_instance": 0}, CaptureError, "samples_per_instance must be at least 1, got 0"),
        ({"min_points": 0}, CaptureError, "min_points"),
        ({"max_depth": 0.1}, CaptureError, "max_depth 0.1 m must exceed"),
        ({"seed": -1}, CaptureError, "seed"),
        ({"resolutions": ("800x600",)}, SensorError, "800x600"),
        ({"resolutions": ("424x240", "424x240")}, CaptureError, "none twice"),
        ({"max_occlusion": 1.5}, CaptureError, "max_occlusion"),
        ({"sensor": "lidar"}, SensorError, "lidar"),
        ({"sensor": "structured_light"}, SensorError, "scenario=free.*tabletop or piled"),
        ({"sensor": "structured_light", "scenario": "tabletop"}, SensorError, "noise.*StructuredLightNoise"),
        (
            {"sensor": "structured_light", "scenario": "tabletop", "noise": StructuredLightNoise()},
            SensorError,
            "424x240.*640x480, 320x240",
        ),
        ({"scenario": "shelf"}, CaptureError, "shelf.*free, tabletop"),
    ],
)
def test_a_configuration_that_makes_no_sense_is_named(change, error, message):
    with pytest.raises(error, match=message):
        CaptureConfig(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": ()}, "classes"),
        ({"classes": ("a", "a")}, "classes"),
        ({"instances_per_class": 0}, "instances"),
        ({"scale": 0.0}, "scale"),
    ],
)
def test_objects_that_make_no_sense_are_named(change, message):
    with pytest.raises(CaptureError, match=message):
        ObjectsConfig(**change)


@pytest.mark.parametrize(
    ("override", "message"), [("objects.classes=[teapot]", "teapot"), ("shard=9/8", "shard='9/8': must be i/n")]
)
def test_the_command_names_what_makes_no_sense(tmp_path, monkeypatch, capsys, override, message):
    monkeypatch.setattr(sys, "argv", ["pecgrasp", "generate", override, f"out={tmp_path / 'data'}"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert message in f"{ended.value.code} {capsys.readouterr().err}"
