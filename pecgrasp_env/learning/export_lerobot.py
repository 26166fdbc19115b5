"""Expert episodes, simulated ones of `pecgrasp record-demos` and real ones of `pecgrasp pick`, as a LeRobot data set.

observation.state (7,): joint angles, rad, and opening, m. action (8,): joint targets, opening, grip force, N, of
`pd_joint_pos`. next.success: something (simulated: the right thing) was up at the end. Of simulated ones also
observation.environment_state (7,): where the asked-for object is, m and quaternion wxyz, base frame; and, where the
replay of the recording has made them, observation.images.wrist_depth: depth of the wrist camera, mm, 0 for none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.common.outcomes import RIGHT
from pecgrasp_env.learning.lerobot_format import DemoEpisode, ExportError

FPS = 20  # control steps a second, in simulation and on an arm at speed=1
_JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
NAMES = {
    "observation.state": [*_JOINTS, "opening"],
    "observation.environment_state": ["x", "y", "z", "qw", "qx", "qy", "qz"],
    "action": [*_JOINTS, "opening", "force"],
}


DEPTH = "observation.images.wrist_depth"
_DEPTH_KEY = "obs/sensor_data/wrist_camera/depth"
_FARTHEST_MM = np.iinfo(np.uint16).max


def read_episodes(source: Path, depth: bool = False) -> Iterator[DemoEpisode]:
    """Of a folder that one of the two commands has left. depth: with pictures, if simulated. Raises ExportError."""
    if (source / "trajectory.h5").exists():
        yield from _simulated(source / "trajectory.h5", depth)
    elif depth:
        raise ExportError(f"{source}: depth=true wants episodes of record-demos; a pick keeps a frame a look")
    elif (source / "steps.jsonl").exists():
        yield _real(source)
    else:
        raise ExportError(f"{source}: neither trajectory.h5 of record-demos nor steps.jsonl of a pick is in it")


def task_of(target: str) -> str:
    """In words."""
    return f"pick up the {target.replace('_', ' ')}"


def _simulated(path: Path, depth: bool) -> Iterator[DemoEpisode]:
    import h5py  # type: ignore[import-untyped]

    info = json.loads(path.with_suffix(".json").read_text())
    pictures = _replayed(path) if depth else {}
    with h5py.File(path) as file:
        for episode in info["episodes"]:
            if episode["control_mode"] != "pd_joint_pos":
                raise ExportError(f"{path}: control mode {episode['control_mode']}: record with pd_joint_pos")
            recorded = file[f"traj_{episode['episode_id']}"]
            actions = np.asarray(recorded["actions"], np.float32)
            n = len(actions)  # of observations there is one more, after the last action
            seen = recorded["obs"]
            images: dict[str, Callable[[], np.ndarray]] = {}
            if depth:
                if (seed := episode["episode_seed"]) not in pictures:
                    raise ExportError(f"{path.parent}: the replay with depth has no episode of seed {seed}: replay all")
                images[DEPTH] = partial(_depth_mm, *pictures[seed], actions[:, :8])
            state = [np.asarray(seen["agent/qpos"][:n, :6]), np.asarray(seen["extra/opening"][:n])]
            yield _episode(
                task_of(episode["expert"]["target"]),
                np.concatenate(state, axis=1),
                actions[:, :8],
                episode["expert"]["outcome"] in RIGHT,
                images,
                **{"observation.environment_state": np.asarray(seen["extra/target_pose"][:n], np.float32)},
            )


def _replayed(path: Path) -> dict[int, tuple[Path, str]]:
    """Seed of an episode → file and trajectory in it, of what ManiSkill's replay has made with depth. Raises
    ExportError.
    """
    files = sorted(path.parent.glob("trajectory.depth.pd_joint_pos.*.h5"))
    if not files:
        way = f"python -m pecgrasp_env.learning.replay --traj-path {path} --use-env-states --save-traj -o depth"
        raise ExportError(f"{path.parent}: no trajectory.depth.pd_joint_pos.*.h5; {way} makes it")
    found = {}
    for file in files:
        for episode in json.loads(file.with_suffix(".json").read_text())["episodes"]:
            found[int(episode["episode_seed"])] = file, f"traj_{episode['episode_id']}"
    return found


def _depth_mm(path: Path, name: str, actions: np.ndarray) -> np.ndarray:
    """(T, H, W) uint16 mm, at the moments of actions (T, 8). Raises ExportError where the replay has others."""
    import h5py

    with h5py.File(path) as file:
        replayed = np.asarray(file[name]["actions"], np.float32)[:, :8]
        if not np.array_equal(replayed, actions):
            raise ExportError(f"{path}, {name}: {len(replayed)} other actions than those recorded: replay it anew")
        metres = np.asarray(file[name][_DEPTH_KEY][: len(actions)])
    return np.clip(np.rint(1e3 * metres[..., 0].astype(np.float64)), 0, _FARTHEST_MM).astype(np.uint16)


def _real(folder: Path) -> DemoEpisode:
    try:
        settings = json.loads((folder / "settings.json").read_text())
        outcome = json.loads((folder / "outcome.json").read_text())
        steps = [json.loads(line) for line in (folder / "steps.jsonl").read_text().splitlines()]
    except (OSError, ValueError) as error:
        raise ExportError(f"{folder}: {error}: a pick that has ended is wanted, no dry run") from error
    if not steps:
        raise ExportError(f"{folder}: the pick has no step")
    state = np.array([[*step["q"], step["opening"]] for step in steps])
    actions = np.array([step["target"][:8] for step in steps])
    return _episode(task_of(settings["target"]), state, actions, bool(outcome["lifted"]), {})


def _episode(
    task: str,
    state: np.ndarray,
    actions: np.ndarray,
    success: bool,
    images: dict[str, Callable[[], np.ndarray]],
    **more: Any,
) -> DemoEpisode:
    last = np.arange(len(actions))[:, None] == len(actions) - 1
    values = {"observation.state": state.astype(np.float32), **more, "action": actions.astype(np.float32)}
    return DemoEpisode(task, values | {"next.done": last, "next.success": last & success}, images)
