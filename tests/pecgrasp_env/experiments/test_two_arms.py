"""The evaluation of two arms: a real episode, that it goes on where it was stopped, and what its numbers mean."""

import json
from dataclasses import replace

import pytest

from pecgrasp_env.evaluation.run import EvaluationError
from pecgrasp_env.experiments.two_arms.episode import DualEpisode
from pecgrasp_env.experiments.two_arms.run import evaluate_dual
from pecgrasp_env.experiments.two_arms.tables import as_markdown, summarise
from pecgrasp_env.policy.two_arms.scripted import TwoArmPolicy

SETTINGS = {
    "episodes": 1,
    "first_seed": 5,
    "methods": ["pair"],
    "env": {"sensor": "ideal", "kinds": ["board"]},
    "films": 0,
    "workers": 1,
}
EPISODE = DualEpisode(0, "pair", "carried", True, "board_1", "board", 4.0, 0.5, 20.0, 0.003, None, [], 160, 0.2)


def test_two_arms_carry_a_board_level_and_the_same_command_goes_on(tmp_path):
    out = tmp_path / "run"
    results = evaluate_dual({**SETTINGS, "out": str(out)})
    episode = json.loads((out / "episodes.jsonl").read_text())
    assert episode["outcome"] == "carried"
    assert episode["worst_tilt"] < 3
    assert episode["centre_error"] < 0.02
    assert results["methods"]["pair"]["carried"]["count"] == 1
    assert json.loads((out / "results.json").read_text()) == results
    with (out / "episodes.jsonl").open("a") as file:
        file.write('{"seed": 6, "meth')  # cut off by a crash
    counted = []
    assert evaluate_dual({**SETTINGS, "out": str(out)}, lambda done, total: counted.append((done, total))) == results
    assert counted == [(1, 1)]
    with pytest.raises(EvaluationError, match="say another out=DIR"):
        evaluate_dual({**SETTINGS, "out": str(out), "env": {"sensor": "d435"}})


@pytest.mark.parametrize(("name", "value"), [("episodes", 0), ("methods", ["three"]), ("methods", []), ("films", -1)])
def test_what_makes_no_sense_is_named(name, value, tmp_path):
    with pytest.raises(EvaluationError, match=f"{name}="):
        evaluate_dual({**SETTINGS, "out": str(tmp_path / "run"), name: value})
    with pytest.raises(ValueError, match="method='three'"):
        TwoArmPolicy("three")


def test_what_is_too_heavy_for_an_arm_counts_only_without_its_payload():
    heavy = replace(EPISODE, method="single", outcome="overloaded", mass=5.0, centre_error=None)
    lost = replace(EPISODE, method="single", seed=1, outcome="tilted", level=False)
    results = summarise({"pair": [EPISODE, replace(EPISODE, seed=1)], "single": [heavy, lost]})
    single = results["methods"]["single"]
    assert (single["carried"]["count"], single["level_without_payload"]["count"]) == (0, 1)
    assert single["worst_tilt_deg"] is None
    assert results["pairs"][0] | {"p": 0.5} == {
        "first": "pair", "second": "single", "both": 0, "only_first": 2, "only_second": 0, "neither": 0, "p": 0.5,
    }  # fmt: skip
    text = as_markdown(results)
    assert "| pair planner | 100.0 % (2/2, 34–100) | 2/2 |" in text
    assert "only the one 2, only the other 0, McNemar p = 0.5" in text
