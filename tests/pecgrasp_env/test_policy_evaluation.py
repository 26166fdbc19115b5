"""The evaluation's numbers, its journal on disk, and its configuration."""

import json
from dataclasses import asdict
from pathlib import Path

import gymnasium as gym
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from grasping import CurvaturePlanner
from pecgrasp_env.evaluation import (
    OUTCOMES,
    Episode,
    EvaluationError,
    Protocol,
    read_episodes,
    run_episodes,
    summarise,
    table,
    wilson_interval,
)

CONF = Path(__file__).parents[2] / "conf"
PROTOCOL = Protocol({"n_objects": 1}, "nowhere", {"_target_": "grasping.CurvaturePlanner"}, {})


def episode(seed, outcome="success", target="mouse"):
    reason = None if outcome == "success" else "because"
    return Episode(seed, target, outcome, reason, [], 70, 1, 0.9, ["mouse_0001"], {"segment": 0.01 * (seed + 1)})


def write(folder, *episodes, tail=""):
    folder.mkdir(exist_ok=True)
    (folder / "protocol.json").write_text(json.dumps(asdict(PROTOCOL), indent=2, sort_keys=True))
    (folder / "episodes.jsonl").write_text("".join(json.dumps(asdict(e)) + "\n" for e in episodes) + tail)


@pytest.mark.parametrize(
    ("successes", "n", "interval"),
    [(19, 20, (0.764, 0.991)), (0, 10, (0.0, 0.278)), (10, 10, (0.722, 1.0)), (50, 100, (0.404, 0.596))],
)
def test_wilson_intervals_of_the_tables(successes, n, interval):
    assert wilson_interval(successes, n) == pytest.approx(interval, abs=5e-4)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_holds_the_share_and_mirrors(case):
    successes, n = case
    low, high = wilson_interval(successes, n)
    assert 0 <= low <= successes / n <= high <= 1
    mirrored = wilson_interval(n - successes, n)
    assert (1 - high, 1 - low) == pytest.approx(mirrored)


@pytest.mark.parametrize(("successes", "n"), [(0, 0), (3, 2), (-1, 5)])
def test_no_proportion_is_refused(successes, n):
    with pytest.raises(EvaluationError, match="no proportion"):
        wilson_interval(successes, n)


def test_what_is_done_is_not_run_again(tmp_path):
    """No environment and no classifier are needed, in the order of the seeds, where the journal holds every episode."""
    write(tmp_path, episode(2, "dropped"), episode(1))
    assert run_episodes(PROTOCOL, [1, 2], tmp_path) == [episode(1), episode(2, "dropped")]


def test_a_line_cut_off_by_a_crash_is_dropped(tmp_path):
    write(tmp_path, episode(1), episode(2), tail='{"seed": 3, "tar')
    assert read_episodes(tmp_path / "episodes.jsonl") == [episode(1), episode(2)]
    assert (tmp_path / "episodes.jsonl").read_text().endswith("}\n")


def test_a_folder_of_another_protocol_is_refused(tmp_path):
    write(tmp_path, episode(1))
    other = Protocol({"n_objects": 2}, "nowhere", PROTOCOL.planner, {})
    with pytest.raises(EvaluationError, match=r"protocol\.json describes another"):
        run_episodes(other, [1], tmp_path)
    with pytest.raises(EvaluationError, match="workers=0"):
        run_episodes(PROTOCOL, [1], tmp_path, workers=0)


def test_the_summary_counts_by_outcome_and_class():
    episodes = [episode(0), episode(1), episode(2, "wrong_object", "stapler"), episode(3, "missed")]
    summary = summarise(episodes)
    assert {name: row["count"] for name, row in summary["outcomes"].items() if row["count"]} == {
        "success": 2,
        "wrong_object": 1,
        "missed": 1,
    }
    assert set(summary["outcomes"]) == set(OUTCOMES)
    assert summary["by_class"]["mouse"]["success"]["share"] == pytest.approx(2 / 3)
    assert summary["reasons"] == {"because": 2}
    assert summary["stage_ms"]["segment"]["median"] == pytest.approx(25.0)
    assert "wrong_object" in table(summary)
    assert "dropped" not in table(summary)


@pytest.mark.parametrize("experiment", sorted(p.stem for p in (CONF / "experiment").glob("selective*.yaml")))
def test_the_configuration_makes_an_environment_and_a_planner(experiment):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("evaluate", overrides=["checkpoint=x", f"experiment={experiment}", "output=y"])
    settings = OmegaConf.to_container(cfg, resolve=True)
    protocol = Protocol(settings["env"], settings["checkpoint"], settings["planner"], settings["policy"])
    env = protocol.make_env()
    assert isinstance(env, gym.Env)
    assert env.unwrapped.n_objects == 3
    assert isinstance(instantiate(protocol.planner), CurvaturePlanner)
    env.close()
