"""`pecgrasp pick` and `pecgrasp replay-pick` from their settings: plain values in, lines for people out."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.interfaces import DepthCamera
from pecgrasp_env.real.pick import STEP_S, Picker
from pecgrasp_env.real.pick_record import PickRecord, decision_of, plan_again, recorded_settings
from pecgrasp_env.real.robotiq import RobotiqGripper
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.real.ur_models import URModel
from pecgrasp_env.real.workspace import Workspace
from pecgrasp_env.robot.camera_mount import read_mount
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA

Say = Callable[[str], None]
_ANSWERS = ("each", "once", "no")


class PickSettingError(RobotError, ValueError):
    """A setting of a pick makes no sense; the message names it."""


def run_pick(
    settings: dict[str, Any], camera: DepthCamera, classifier: Any, planner: Any, ask: Callable[[str], bool], say: Say
) -> bool:
    """One pick, or one look; whether it went as it should.

    settings: those of conf/pick.yaml. ask: whether the user agrees to a motion, in words.
    """
    if settings["confirm"] not in _ANSWERS:
        raise PickSettingError(f"confirm={settings['confirm']}: must be one of {', '.join(_ANSWERS)}")
    model = URModel.from_mapping(settings["robot"])
    if not model.plans:
        raise PickSettingError(
            f"robot={model.name}: motions are planned for a UR5's lengths; look and plan with others"
        )
    box = settings["workspace"]
    workspace = Workspace(tuple(box["low"]), tuple(box["high"]), box["table"], box["max_force"])
    policy = ScriptedPolicy(classifier, planner, control_dt=STEP_S * settings["speed"], **settings["policy"])
    T_tool0_camera = T_TOOL0_CAMERA if settings["calibration"] is None else read_mount(settings["calibration"])
    record = PickRecord(Path(settings["output"]), settings)
    payload = (float(settings["payload"]), tuple(settings["payload_centre"]))
    arm = URArm(settings["host"], model, payload=payload, patience=settings["patience"])
    try:
        gripper = RobotiqGripper(settings["host"])
        try:
            asked = Agreement(settings["confirm"], ask)
            picker = Picker(
                arm,
                gripper,
                camera,
                policy,
                workspace,
                speed=settings["speed"],
                ask=None if settings["confirm"] == "no" else asked.agrees,
                record=record,
                T_tool0_camera=T_tool0_camera,
            )
            target = settings["target"]
            good = (
                _look(picker, policy, record, target, say)
                if settings["dry_run"]
                else _pick(picker, policy, record, target, say)
            )
        finally:
            gripper.close()
    finally:
        arm.close()
    say(f"all of it in {record.folder}")
    return good


class Agreement:
    """Asks before each motion, or before the first."""

    def __init__(self, confirm: str, ask: Callable[[str], bool]) -> None:
        self._confirm, self._ask = confirm, ask
        self._agreed = False

    def agrees(self, doing: str, action: np.ndarray) -> bool:
        if self._confirm == "once" and self._agreed:
            return True
        self._agreed = self._ask(doing)
        return self._agreed


def _look(picker: Picker, policy: ScriptedPolicy, record: PickRecord, target: str, say: Say) -> bool:
    observation = picker.observe()
    frame = observation.frame
    pick = policy.plan_only(
        frame.depth, frame.intrinsics, observation.T_base_camera, target, q=observation.q, opening=observation.opening
    )
    decision = decision_of(pick)
    record.decided(decision)
    for line in lines_of(decision):
        say(line)
    if pick.approach is not None:
        paths = ("to_pregrasp", "to_grasp", "to_close", "to_lift")
        np.savez(record.folder / "paths.npz", **{name: getattr(pick.approach, name) for name in paths})
        say("the way there is planned; nothing was moved: dry_run=false moves")
    return pick.reason is None


def _pick(picker: Picker, policy: ScriptedPolicy, record: PickRecord, target: str, say: Say) -> bool:
    started = time.monotonic()
    outcome = picker.pick(target)
    record.ended(outcome, policy)
    for k, failure in enumerate(policy.log.failures, start=1):
        say(f"try {k}: {failure}")
    if outcome.error is not None:
        say(f"{type(outcome.error).__name__}: {outcome.error}")
    elif outcome.lifted:
        say(f"holds the {target}, {1e3 * (policy.log.held_m or 0):.0f} mm wide")
    else:
        say(f"gave up: {outcome.reason}")
    took = time.monotonic() - started
    say(f"{outcome.seconds:.1f} s of the arm's clock, {took:.1f} s of ours, {outcome.step_ms:.0f} ms a step")
    return outcome.lifted


def run_replay(folder: Path, target: str | None, policy: ScriptedPolicy, say: Say) -> list[dict[str, Any]]:
    """Each recorded frame of a run, planned again; what was decided, frame by frame. Raises RecordError."""
    target = target or str(recorded_settings(folder)["target"])
    decisions = []
    for k, (_, pick) in enumerate(plan_again(folder, policy, target)):
        decisions.append(decision_of(pick))
        say(f"frame {k}")
        for line in lines_of(decisions[-1]):
            say(f"  {line}")
    return decisions


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
