"""What a data set is made of: the defaults, the configurations that are shipped, and those that make no sense."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig
from pecgrasp_env.objects import CLASSES, LARS_CLASSES
from pecgrasp_env.sensor import SensorError

ROOT = Path(__file__).parents[2]


def test_the_default_is_the_lars_set():
    config = CaptureConfig()
    assert config.samples_per_instance == 1000
    assert config.objects == ObjectsConfig()
    assert len(LARS_CLASSES) == 5


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["dataset=lars"],
        ["objects=catalogue"],
        ["sensor=d435"],
        ["scenario=tabletop", "sensor=d435"],
        ["dataset=ycb"],
    ],
)
def test_the_configurations_that_are_shipped_say_what_the_code_defaults_to(overrides):
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        settings = compose("generate", ["out=unused", *overrides])
    config = CaptureConfig.from_settings(OmegaConf.to_container(settings, resolve=True))
    classes = CLASSES if "objects=catalogue" in overrides else None
    source = "ycb" if "dataset=ycb" in overrides else "catalogue"
    objects = ObjectsConfig(source=source, classes=classes, instances_per_class=10 if classes else None)
    scenario = "tabletop" if "scenario=tabletop" in overrides else "free"
    sensor = "d435" if "sensor=d435" in overrides else "ideal"
    assert config == CaptureConfig(objects=objects, scenario=scenario, sensor=sensor, resolutions=("848x480",))


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


def test_the_script_names_the_class_that_does_not_exist(tmp_path):
    done = subprocess.run(
        [sys.executable, "scripts/generate_dataset.py", "objects.classes=[teapot]", f"out={tmp_path / 'data'}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env={**os.environ, "HYDRA_FULL_ERROR": "0"},
    )
    assert done.returncode == 1
    assert "teapot" in done.stderr
    assert "Traceback" not in done.stderr
