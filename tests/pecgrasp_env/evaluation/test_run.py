"""Episodes in their journal: run once, shared by jobs, gone on with after a crash, the same whoever runs them."""

import json
import shutil
from dataclasses import asdict, replace

import numpy as np
import pytest
import trimesh

from pecgrasp_env.common.job_share import JobShare
from pecgrasp_env.common.outcomes import OUTCOMES
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.evaluation.episode import Episode
from pecgrasp_env.evaluation.run import EvaluationError, Protocol, read_episodes, run_episodes
from pecgrasp_env.evaluation.summary import summarise, table

PROTOCOL = Protocol({"n_objects": 1}, "nowhere", {"_target_": "grasping.CurvaturePlanner"}, {})
ALONE = Protocol(
    {"n_objects": 1, "classes": ["plug_adapter"], "sensor": "d435", "objects": {"seed": 1000}},
    None,
    {"_target_": "grasping.CentroidPlanner"},
    {"attempts": 1},
)


def episode(seed, outcome="success", target="mouse", **changes):
    reason = None if outcome == "success" else "because of 3.5 mm"
    stages = {"segment": [0.01 * (seed + 1), 0.01]}
    return replace(Episode(seed, target, outcome, reason, [], 70, 1, 0.9, ["mouse_0001"], stages), **changes)


def write(folder, *episodes, name="episodes.jsonl", tail=""):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text("".join(json.dumps(asdict(e)) + "\n" for e in episodes) + tail)


def untimed(episodes):
    return [replace(each, stages={name: len(calls) for name, calls in each.stages.items()}) for each in episodes]


# The journal


def test_what_is_done_is_not_run_again(tmp_path):
    """Neither environment nor classifier is needed, in the order of the seeds, where every episode is there."""
    write(tmp_path, episode(2, "dropped"), episode(1))
    assert run_episodes(PROTOCOL, [1, 2], tmp_path) == [episode(1), episode(2, "dropped")]


def test_a_line_cut_off_by_a_crash_is_no_episode(tmp_path):
    write(tmp_path, episode(1), episode(2), tail='{"seed": 3, "tar')
    assert read_episodes(tmp_path) == [episode(1), episode(2)]
    assert run_episodes(PROTOCOL, [1, 2], tmp_path) == [episode(1), episode(2)]
    assert (tmp_path / "episodes.jsonl").read_text().endswith("}\n")


def test_a_line_that_another_job_is_writing_is_left_alone(tmp_path):
    write(tmp_path, episode(1), tail='{"seed": 3, "tar', name="episodes.1of2.jsonl")
    write(tmp_path, episode(0), name="episodes.0of2.jsonl")
    assert run_episodes(PROTOCOL, [0, 1], tmp_path, share=JobShare(0, 2)) == [episode(0), episode(1)]


def test_the_last_part_joins_all_of_them_in_order(tmp_path):
    write(tmp_path, episode(1), episode(3), name="episodes.1of2.jsonl")
    write(tmp_path, episode(2), episode(0), name="episodes.0of2.jsonl")
    run_episodes(PROTOCOL, range(4), tmp_path, share=JobShare(1, 2))
    assert [path.name for path in tmp_path.iterdir()] == ["episodes.jsonl"]
    assert read_episodes(tmp_path) == [episode(seed) for seed in range(4)]


def test_an_error_is_replaced_by_an_episode(tmp_path):
    write(tmp_path, episode(1, "error"), episode(1, "missed"), episode(1, "error"))
    assert read_episodes(tmp_path) == [episode(1, "missed")]


def test_no_workers_and_no_classifier_are_refused(tmp_path):
    with pytest.raises(EvaluationError, match="workers=0"):
        run_episodes(PROTOCOL, [1], tmp_path, workers=0)
    with pytest.raises(EvaluationError, match=r"checkpoint=null: .* do\. Give checkpoint=DIR"):
        Protocol({"classes": ["mouse", "can"]}, None, PROTOCOL.planner, {}).make_policy()


# In the simulator


def test_the_classes_of_a_mesh_folder_are_those_that_may_be_asked_for(tmp_path):
    for name in ("brick", "stick"):
        (tmp_path / name).mkdir()
        size = (0.05, 0.05, 0.04) if name == "brick" else (0.12, 0.02, 0.02)
        trimesh.creation.box(size).export(tmp_path / name / "one.ply")
    protocol = Protocol({"n_objects": 2, "classes": None, "objects": {"path": str(tmp_path)}}, None, {}, {})
    env = protocol.make_env(obs_mode="state", render_backend="none")
    assert env.unwrapped.classes == ("brick", "stick")
    assert env.reset(seed=0)[1]["target"][0] in ("brick", "stick")
    env.close()


def test_a_folder_of_one_class_needs_no_classifier(tmp_path):
    (tmp_path / "brick").mkdir()
    trimesh.creation.box((0.05, 0.05, 0.04)).export(tmp_path / "brick" / "one.ply")
    protocol = Protocol({"objects": {"path": str(tmp_path)}}, None, PROTOCOL.planner, {})
    assert protocol.make_policy() is not None
    with pytest.raises(TaskError, match=r"n_objects=3.*n_objects=1"):
        protocol.make_env()


@pytest.fixture(scope="module")
def in_one_go(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, run_episodes(ALONE, [7, 8], folder)


def test_parts_are_the_episodes_of_one_run_and_go_on_after_a_crash(in_one_go, tmp_path):
    folder, whole = in_one_go
    ran = []
    journal = tmp_path / "episodes.1of2.jsonl"
    run_episodes(ALONE, [7, 8], tmp_path, share=JobShare(1, 2), on_episode=ran.append)
    assert [each.seed for each in ran] == [8]
    journal.write_text(journal.read_text() + '{"seed": 7, "target": "plu')
    told = []
    parts = run_episodes(
        ALONE, [7, 8], tmp_path, on_episode=ran.append, progress=lambda done, total: told.append((done, total))
    )
    assert [each.seed for each in ran] == [8, 7]
    assert told == [(1, 2), (2, 2)]
    assert untimed(parts) == untimed(whole)
    assert [path.name for path in tmp_path.iterdir()] == [path.name for path in folder.iterdir()] == ["episodes.jsonl"]


def test_an_episode_that_raises_is_an_error_and_is_tried_again(in_one_go, tmp_path):
    shutil.copy(in_one_go[0] / "episodes.jsonl", tmp_path)
    mute = replace(ALONE, planner={"_target_": "builtins.dict"})
    done = run_episodes(mute, [7, 8, 9], tmp_path)
    assert [each.outcome == "error" for each in done] == [False, False, True]
    assert done[2].reason == "AttributeError: 'dict' object has no attribute 'plan'"
    assert summarise(done)["outcomes"]["error"]["count"] == 1
    ran = []
    run_episodes(mute, [7, 8, 9], tmp_path, on_episode=ran.append)
    assert [each.seed for each in ran] == [9]


def test_every_planner_meets_the_same_scenes():
    """What an environment has been through, under whichever planner, leaves no trace in the next seed's scene."""
    poses, depths = [], []
    for planner, seeds in (("CentroidPlanner", (3, 4)), ("PublishedPlanner", (4,))):
        protocol = replace(ALONE, planner={"_target_": f"grasping.{planner}"})
        env, policy = protocol.make_env(), protocol.make_policy()
        for seed in seeds:
            obs, info = env.reset(seed=seed)
            first = obs
            policy.reset(info["target"][0])
            for _ in range(45 if seed == 3 else 1):
                obs, *_ = env.step(policy.act(obs))
        poses.append(env.unwrapped.objects[0].pose.raw_pose.numpy())
        depths.append(first["sensor_data"]["wrist_camera"]["depth"].numpy())
        assert protocol.make_policy().planner.__class__.__name__ == planner
        env.close()
    assert np.array_equal(poses[0], poses[1])
    assert np.array_equal(depths[0], depths[1])


# Summaries


def test_the_summary_counts_by_outcome_and_class():
    episodes = [episode(0), episode(1, disturbance_m=0.02), episode(2, "wrong_object", "stapler"), episode(3, "missed")]
    episodes[3] = replace(episodes[3], failures=["2 mm off", "30 mm off"], disturbance_m=0.004)
    summary = summarise(episodes)
    assert {name: row["count"] for name, row in summary["outcomes"].items() if row["count"]} == {
        "success": 2,
        "wrong_object": 1,
        "missed": 1,
    }
    assert set(summary["outcomes"]) == set(OUTCOMES)
    assert summary["by_class"]["mouse"]["success"]["share"] == pytest.approx(2 / 3)
    assert summary["first_try"]["count"] == 2
    assert summarise([replace(episodes[0], failures=["x"])])["first_try"]["count"] == 0
    assert summary["reasons"] == {"because of # mm": 2}
    assert summary["failures"] == {"# mm off": 2}
    assert summary["stage_ms"]["segment"] == pytest.approx({"median": 10.0, "p95": 36.5, "most": 40.0, "n": 8})
    assert summary["disturbance_mm"]["median"] == pytest.approx(12)
    assert "wrong_object" in table(summary)
    assert "dropped" not in table(summary)
