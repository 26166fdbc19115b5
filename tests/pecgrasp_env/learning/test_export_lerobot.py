"""LeRobot data sets: the files are as its documentation of the format v3.0 says, and lerobot itself reads them."""

import importlib.util
import io
import json
import subprocess
import sys

import h5py
import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="pip install 'pecgrasp[lerobot]'")

import pyarrow.parquet as pq
from PIL import Image

from pecgrasp.cli import main
from pecgrasp_env.learning.export_lerobot import DEPTH, FPS
from pecgrasp_env.learning.lerobot_format import DemoEpisode, ExportError, write_data_set

LENGTHS = (5, 3)
TARGETS = ("plug_adapter", "mouse")


@pytest.fixture
def demos(tmp_path):
    """What `pecgrasp record-demos` leaves, as far as it is exported."""
    folder = tmp_path / "demos"
    folder.mkdir()
    rng = np.random.default_rng(0)
    episodes = []
    with h5py.File(folder / "trajectory.h5", "w") as file:
        for k, (length, target) in enumerate(zip(LENGTHS, TARGETS, strict=True)):
            group = file.create_group(f"traj_{k}")
            group["actions"] = rng.normal(size=(length, 8)).astype(np.float32)
            group["obs/agent/qpos"] = rng.normal(size=(length + 1, 10)).astype(np.float32)
            group["obs/extra/opening"] = rng.uniform(0, 0.14, (length + 1, 1)).astype(np.float32)
            group["obs/extra/target_pose"] = rng.normal(size=(length + 1, 7)).astype(np.float32)
            expert = {"target": target, "outcome": "success" if k == 0 else "gave_up"}
            about = {"episode_id": k, "episode_seed": 70 + k, "control_mode": "pd_joint_pos"}
            episodes.append(about | {"expert": expert})
    (folder / "trajectory.json").write_text(json.dumps({"episodes": episodes}))
    return folder


def replayed(folder):
    """What ManiSkill's replay leaves beside them, as far as it is exported, in another order."""
    rng = np.random.default_rng(1)
    depths, episodes = [], []
    name = folder / "trajectory.depth.pd_joint_pos.physx_cpu"
    with h5py.File(folder / "trajectory.h5") as made, h5py.File(name.with_suffix(".physx_cpu.h5"), "w") as file:
        for k, other in enumerate((1, 0)):
            actions = np.asarray(made[f"traj_{other}/actions"])
            depth = rng.uniform(0, 1.5, (len(actions) + 1, 6, 8, 1)).astype(np.float32)
            depth[:, 0, 0] = 0
            file[f"traj_{k}/actions"] = actions
            file[f"traj_{k}/obs/sensor_data/wrist_camera/depth"] = depth
            episodes.append({"episode_id": k, "episode_seed": 70 + other, "control_mode": "pd_joint_pos"})
            depths.insert(0, np.rint(1e3 * depth[:-1, ..., 0].astype(float)))
    name.with_suffix(".physx_cpu.json").write_text(json.dumps({"episodes": episodes}))
    return np.concatenate(depths)


def picked(folder, target, lifted, n=4):
    """What `pecgrasp pick` leaves, as far as it is exported."""
    folder.mkdir()
    (folder / "settings.json").write_text(json.dumps({"target": target}))
    (folder / "outcome.json").write_text(json.dumps({"lifted": lifted}))
    steps = [{"doing": "looking", "q": [0.1 * k] * 6, "opening": 0.14, "target": [0.1 * k] * 8} for k in range(n)]
    (folder / "steps.jsonl").write_text("".join(json.dumps(step) + "\n" for step in steps))
    return folder


def export(*overrides):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", "export-lerobot", *overrides])
        main()


def test_simulated_episodes_become_files_of_the_documented_format(demos, tmp_path):
    out = tmp_path / "out"
    export(f"source={demos}", f"out={out}")
    info = json.loads((out / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 8, 2)
    assert (info["fps"], info["splits"]) == (FPS, {"train": "0:2"})
    data = pq.read_table(out / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        values = np.array(data[name].to_pylist())
        assert values.shape == ((8,) if feature["shape"] == [1] else (8, *feature["shape"])), name
        if feature["names"] is not None:
            assert len(feature["names"]) == feature["shape"][0]
    assert data["index"].to_pylist() == list(range(8))
    assert data["frame_index"].to_pylist() == [0, 1, 2, 3, 4, 0, 1, 2]
    assert data["timestamp"].to_pylist() == pytest.approx([0, 0.05, 0.1, 0.15, 0.2, 0, 0.05, 0.1])
    assert data["next.success"].to_pylist() == [False] * 4 + [True] + [False] * 3
    with h5py.File(demos / "trajectory.h5") as file:
        actions = np.concatenate([file[f"traj_{k}/actions"] for k in range(2)])
        states = np.concatenate([file[f"traj_{k}/obs/agent/qpos"][:n, :6] for k, n in enumerate(LENGTHS)])
    np.testing.assert_array_equal(np.array(data["action"].to_pylist(), np.float32), actions)
    np.testing.assert_array_equal(np.array(data["observation.state"].to_pylist(), np.float32)[:, :6], states)
    episodes = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [each["length"] for each in episodes] == list(LENGTHS)
    assert [(each["dataset_from_index"], each["dataset_to_index"]) for each in episodes] == [(0, 5), (5, 8)]
    assert episodes[0]["tasks"] == ["pick up the plug adapter"]
    stats = json.loads((out / "meta/stats.json").read_text())
    assert set(stats) == set(info["features"])
    assert stats["action"]["mean"] == pytest.approx(actions.mean(axis=0), abs=1e-6)
    assert stats["action"]["count"] == [8]
    assert stats["action"]["q50"] == pytest.approx(np.median(actions, axis=0), abs=1e-6)


def test_depth_that_the_replay_made_is_exported_to_the_millimetre(demos, tmp_path):
    depth = replayed(demos)
    export(f"source={demos}", f"out={tmp_path}/out", "depth=true")
    info = json.loads((tmp_path / "out/meta/info.json").read_text())
    assert info["features"][DEPTH] == {"dtype": "image", "shape": [6, 8, 1], "names": ["height", "width", "channels"]}
    rows = pq.read_table(tmp_path / "out/data/chunk-000/file-000.parquet").to_pylist()
    read = [np.array(Image.open(io.BytesIO(row[DEPTH]["bytes"]))) for row in rows]
    np.testing.assert_array_equal(read, depth)
    stats = json.loads((tmp_path / "out/meta/stats.json").read_text())[DEPTH]
    assert stats["count"] == [8]
    for name, value in (("min", depth.min()), ("max", depth.max()), ("mean", depth.mean()), ("std", depth.std())):
        assert np.array(stats[name]).reshape(()) == pytest.approx(value, abs=1e-6), name
    assert np.array(stats["q50"]).reshape(()) == pytest.approx(np.median(depth), abs=20)
    episodes = pq.read_table(tmp_path / "out/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [each[f"stats/{DEPTH}/count"] for each in episodes] == [[5], [3]]


def test_depth_that_is_not_there_says_how_it_is_made(demos, tmp_path):
    with pytest.raises(SystemExit, match=r"learning.replay --traj-path .*trajectory.h5 .*-o depth makes it"):
        export(f"source={demos}", f"out={tmp_path}/out", "depth=true")
    with pytest.raises(SystemExit, match="a pick keeps a frame a look"):
        export(f"source={picked(tmp_path / 'a', 'mouse', True)}", f"out={tmp_path}/out", "depth=true")
    replayed(demos)
    with h5py.File(demos / "trajectory.h5", "a") as file:
        file["traj_1/actions"][0, 0] += 1
    with pytest.raises(SystemExit, match="other actions than those recorded"):
        export(f"source={demos}", f"out={tmp_path}/out", "depth=true")


def test_picks_of_an_arm_become_a_data_set_and_lost_ones_say_so(tmp_path):
    folders = [picked(tmp_path / "a", "stapler", True), picked(tmp_path / "b", "stapler", False, n=2)]
    export(f"source=[{folders[0]},{folders[1]}]", f"out={tmp_path}/out")
    data = pq.read_table(tmp_path / "out/data/chunk-000/file-000.parquet")
    assert data["next.success"].to_pylist() == [False] * 3 + [True] + [False] * 2
    assert data["next.done"].to_pylist() == [False] * 3 + [True, False, True]
    assert data["task_index"].to_pylist() == [0] * 6
    assert pq.read_table(tmp_path / "out/meta/tasks.parquet")["__index_level_0__"].to_pylist() == [
        "pick up the stapler"
    ]


def test_what_cannot_be_exported_is_named(demos, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(SystemExit, match=r"neither trajectory.h5 of record-demos nor steps.jsonl"):
        export(f"source={tmp_path}/empty", f"out={tmp_path}/out")
    pick = picked(tmp_path / "pick", "mouse", True)
    with pytest.raises(SystemExit, match=r"episode 2 has observation.state, action"):
        export(f"source=[{demos},{pick}]", f"out={tmp_path}/out")
    (pick / "outcome.json").unlink()
    with pytest.raises(SystemExit, match="a pick that has ended is wanted"):
        export(f"source={pick}", f"out={tmp_path}/out")
    with pytest.raises(SystemExit, match=r"out=.*is there already"):
        export(f"source={demos}", f"out={demos}")
    with pytest.raises(ExportError, match="no episode"):
        write_data_set(tmp_path / "none", [], FPS, "ur5", {})


def test_simulated_episodes_are_exported_without_a_simulator(demos):
    """As with `pip install '.[lerobot]'` alone."""
    program = (
        "import sys\n"
        "sys.modules.update(dict.fromkeys(['torch', 'sapien', 'mani_skill', 'gymnasium', 'trimesh', 'tqdm']))\n"
        "from pathlib import Path\n"
        "from pecgrasp_env.learning.export_lerobot import read_episodes\n"
        "print(len(list(read_episodes(Path(sys.argv[1])))))"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(demos)], capture_output=True, text=True)
    assert ended.stdout == "2\n", ended.stderr


@pytest.mark.skipif(
    importlib.util.find_spec("lerobot") is None, reason="pip install lerobot, in an environment of its own"
)
def test_lerobot_reads_it_back(tmp_path):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    rng = np.random.default_rng(0)
    tasks = ("pick up the mouse", "pick up the can", "pick up the mouse")
    episodes = [
        DemoEpisode(task, {"observation.state": rng.normal(size=(n, 7)).astype(np.float32),
                           "action": rng.normal(size=(n, 8)).astype(np.float32),
                           "next.done": np.arange(n)[:, None] == n - 1},
                    {DEPTH: lambda n=n: np.arange(n * 48, dtype=np.uint16).reshape(n, 6, 8) * 300})
        for task, n in zip(tasks, (4, 6, 3), strict=True)
    ]  # fmt: skip
    write_data_set(tmp_path / "set", episodes, FPS, "ur5", {})
    read = LeRobotDataset("pecgrasp/test", root=tmp_path / "set", delta_timestamps={"action": [0, 1 / FPS]})
    assert (len(read), read.num_episodes, read.fps) == (13, 3, FPS)
    start = 0
    for number, episode in enumerate(episodes):
        for k in range(len(episode)):
            item = read[start + k]
            assert item["task"] == episode.task
            assert int(item["episode_index"]) == number
            np.testing.assert_array_equal(item["observation.state"].numpy(), episode.values["observation.state"][k])
            following = episode.values["action"][[k, min(k + 1, len(episode) - 1)]]
            np.testing.assert_array_equal(item["action"].numpy(), following)
            depth = item[DEPTH].numpy()
            assert depth.shape == (1, 6, 8)
            np.testing.assert_array_equal(depth[0].astype(np.uint16), episode.images[DEPTH]()[k])
        start += len(episode)
