"""A pick as a folder: every frame, what was made of it, every step, and how it ended; and the same planned again.

settings.json what the run was started with, and the arm's measured lengths · frames/000.npz depth (m), K,
T_base_camera, q, opening · decisions.jsonl one line a frame · steps.jsonl one line a step · outcome.json
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from grasping.errors import DAMAGED_NPZ
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.camera.recorded import intrinsics_of_stored, stored_K
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.pick import PickOutcome
from pecgrasp_env.real.ur_models import UR5, URModel
from pecgrasp_env.robot.arm_lengths import ArmLengths


class RecordError(RobotError, ValueError):
    """The folder holds no recorded pick; the message names the file that is missing."""


class PickRecord:
    """Writes a run into a folder of its own, line by line, so that what was there before an error is there after it."""

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self.folder = folder
        (folder / "frames").mkdir(parents=True)
        _write(folder / "settings.json", settings)
        self._frames = 0
        self._steps = (folder / "steps.jsonl").open("w")

    def frame(self, observation: RobotObservation, frame: DepthFrame) -> None:
        write_frame(self.folder / "frames" / f"{self._frames:03}.npz", observation, frame)
        self._frames += 1

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None:
        line = {
            "doing": doing,
            "q": np.round(observation.q, 5).tolist(),
            "opening": round(observation.opening, 5),
            "target": np.round(action.astype(float), 5).tolist(),
        }
        self._steps.write(json.dumps(line) + "\n")
        self._steps.flush()

    def decided(self, decision: dict[str, Any]) -> None:
        with (self.folder / "decisions.jsonl").open("a") as lines:
            lines.write(json.dumps(decision) + "\n")

    def ended(self, outcome: PickOutcome, policy: ScriptedPolicy) -> None:
        log = policy.log
        error = None if outcome.error is None else [type(outcome.error).__name__, str(outcome.error)]
        told = asdict(outcome) | {"error": error, "failures": log.failures, "doubts": log.doubts, "views": log.views}
        _write(self.folder / "outcome.json", told | {"held_m": log.held_m, "confidence": log.confidence})
        self._steps.close()


def write_frame(path: Path, observation: RobotObservation, frame: DepthFrame) -> None:
    """A frame that `RecordedCamera` reads, too, with where the camera and the arm were. Depth is kept as it came, so
    that planning it again is the same to the bit.
    """
    np.savez_compressed(
        path,
        depth=frame.depth,
        K=stored_K(frame.intrinsics),
        T_base_camera=observation.T_base_camera,
        q=observation.q,
        opening=observation.opening,
    )


def decision_of(pick: PlannedPick) -> dict[str, Any]:
    """What was seen, chosen and planned, as plain values: places in m, base frame."""
    objects = []
    for seen in pick.objects:
        shares = seen.probabilities()
        label = max(shares, key=lambda name: shares[name])
        objects.append({"label": label, "share": round(shares[label], 3), "place": np.round(seen.centroid, 4).tolist()})
    return {
        "objects": objects,
        "chosen": pick.chosen,
        "confidence": round(float(pick.confidence), 3),
        "reason": pick.reason,
        "doubt": pick.doubt,
        "absent": pick.absent,
        "T_base_grasp": None if pick.T_base_grasp is None else np.round(pick.T_base_grasp, 5).tolist(),
        "width": None if pick.width is None else round(float(pick.width), 4),
        "opening": None if pick.opening is None else round(float(pick.opening), 4),
    }


def lines_of(decision: dict[str, Any]) -> list[str]:
    """What was seen and decided, for people."""
    lines = []
    for k, each in enumerate(decision["objects"]):
        x, y, _ = each["place"]
        chosen = "  <- this one" if k == decision["chosen"] else ""
        lines.append(f"{each['label']:16} {100 * each['share']:3.0f} %  at x {x:.3f}, y {y:.3f} m{chosen}")
    if decision["T_base_grasp"] is not None:
        x, y, z = (row[3] for row in decision["T_base_grasp"][:3])
        lines.append(f"grasp at {x:.3f}, {y:.3f}, {z:.3f} m, {1e3 * decision['width']:.0f} mm wide")
    if decision["reason"] is not None:
        lines.append(f"nothing to do: {decision['reason']}")
    if decision["doubt"] is not None:
        lines.append(f"better look again: {decision['doubt']}")
    return lines


def recorded_frames(folder: Path) -> Iterator[dict[str, Any]]:
    """Of each frame of a run depth, intrinsics, T_base_camera, q and opening, in their order. Raises RecordError."""
    files = sorted((folder / "frames").glob("*.npz"))
    if not files:
        raise RecordError(f"{folder}/frames holds no recorded frame: a folder that pecgrasp pick has left?")
    for file in files:
        try:
            with np.load(file) as held:
                frame = {
                    "depth": held["depth"],
                    "intrinsics": intrinsics_of_stored(held["K"], held["depth"].shape),
                    "T_base_camera": held["T_base_camera"],
                    "q": held["q"],
                    "opening": float(held["opening"]),
                }
        except DAMAGED_NPZ as error:
            raise RecordError(f"{file} is damaged: {error}; without it the other frames can be replayed") from error
        yield frame


def recorded_settings(folder: Path) -> dict[str, Any]:
    """What the run was started with. Raises RecordError."""
    try:
        settings: dict[str, Any] = json.loads((folder / "settings.json").read_text())
    except (OSError, ValueError) as error:
        raise RecordError(f"{folder}/settings.json: {error}; a folder that pecgrasp pick has left?") from error
    return settings


def recorded_arm(folder: Path) -> ArmLengths:
    """The arm with which the run was made; a UR5 where it does not say. Raises RecordError."""
    settings = recorded_settings(folder)
    if "robot" not in settings:
        return UR5.lengths
    try:
        model = URModel.from_mapping({"footprint": UR5.footprint} | settings["robot"])  # of older runs
        measured = settings.get("measured_lengths")
        return model.lengths.with_measured(None if measured is None else np.array(measured, float).reshape(6, 4))
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError(f"{folder}/settings.json: robot: {error}") from error


def plan_again(folder: Path, policy: ScriptedPolicy, target: str) -> Iterator[tuple[dict[str, Any], PlannedPick]]:
    """Each recorded frame and what today's code makes of it by itself."""
    for frame in recorded_frames(folder):
        yield frame, policy.plan_only(**frame, target=target)


def _write(file: Path, values: dict[str, Any]) -> None:
    file.write_text(json.dumps(values, indent=1, default=str) + "\n")
