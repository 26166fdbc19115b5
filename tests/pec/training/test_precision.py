"""precision=auto: measured when a run begins, never the slower one, said, and kept to the run's end."""

import json

import numpy as np
import pytest
import torch

from pec.errors import ConfigError
from pec.training.loop import train
from pec.training.precision import LEAST_SPEEDUP, Precision, choose_precision

CPU = torch.device("cpu")


def test_what_is_slower_in_bfloat16_trains_in_float32():
    values = np.ones(2_000)
    chosen = choose_precision(lambda name: [values.sum() for _ in range(400 if name == "bfloat16" else 4)], CPU)
    assert chosen.used == "float32"
    assert chosen.bfloat16_speedup < 1


def test_a_step_that_is_much_faster_in_bfloat16_is_taken_unless_its_products_are_hopeless():
    values = np.ones(2_000)
    tried = set()

    def step(name: str) -> None:
        tried.add(name)
        for _ in range(4 if name == "bfloat16" else 400):
            values.sum()

    chosen = choose_precision(step, CPU)
    # A processor without the instructions is not even asked to make a step.
    assert chosen.used == ("bfloat16" if tried else "float32")
    assert (chosen.bfloat16_speedup > LEAST_SPEEDUP) == bool(tried)


def _settings(shapes, output, **protocol):
    return {
        "dataset": {"path": str(shapes), "samples_per_instance": 10},
        "output": str(output),
        "protocol": {"epochs": 1} | protocol,
        "progress": False,
    }


def test_a_run_says_what_it_was_made_in_and_keeps_it(shapes, tmp_path):
    results = train(_settings(shapes, tmp_path))
    measured = results["precision"]
    assert measured["asked"] == "auto"
    assert measured["used"] == ("bfloat16" if measured["bfloat16_speedup"] > LEAST_SPEEDUP else "float32")
    assert results["config"]["protocol"]["precision"] == "auto"  # the same run, whatever the machine
    # Taken to a machine that would choose otherwise, an interrupted run goes on as it began.
    progress = tmp_path / "last" / "training_state" / "progress.json"
    other = {"asked": "auto", "used": "bfloat16", "bfloat16_speedup": 2.5}
    progress.write_text(json.dumps(json.loads(progress.read_text()) | {"precision": other}))
    (tmp_path / "results.json").unlink()
    assert train(_settings(shapes, tmp_path))["precision"] == other


@pytest.mark.parametrize("name", ["float32", "bfloat16"])
def test_what_is_asked_for_is_used_without_measuring(shapes, tmp_path, name):
    results = train(_settings(shapes, tmp_path, precision=name))
    assert Precision(**results["precision"]) == Precision(name, name, None)


def test_the_measure_changes_nothing(shapes, tmp_path):
    losses = [
        train(_settings(shapes, tmp_path / name, precision=name))["curves"]["train_loss"]
        for name in ("auto", "float32")
    ]
    used = json.loads((tmp_path / "auto" / "results.json").read_text())["precision"]["used"]
    assert (losses[0] == losses[1]) == (used == "float32")


def test_an_unknown_precision_is_named(shapes, tmp_path):
    with pytest.raises(ConfigError, match=r"protocol\.precision must be one of auto, float32, bfloat16, got 'half'"):
        train(_settings(shapes, tmp_path, precision="half"))
