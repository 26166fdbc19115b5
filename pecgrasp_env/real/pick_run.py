"""`pecgrasp pick` and `pecgrasp replay-pick` from their settings: plain values in, lines for people out."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.policy.viewpoints import ASIDE
from pecgrasp_env.real.connected import Agreement, connected, mount_of_setting, workspace_of
from pecgrasp_env.real.interfaces import DepthCamera
from pecgrasp_env.real.pick import STEP_S, Picker
from pecgrasp_env.real.pick_record import PickRecord, decision_of, plan_again, recorded_settings

Say = Callable[[str], None]


def run_pick(
    settings: dict[str, Any], camera: DepthCamera, classifier: Any, planner: Any, ask: Callable[[str], bool], say: Say
) -> bool:
    """One pick, or one look; whether it went as it should.

    settings: those of conf/pick.yaml. ask: whether the user agrees to a motion, in words.
    """
    agreement = Agreement(settings["confirm"], ask)
    workspace, mount = workspace_of(settings["workspace"]), mount_of_setting(settings["calibration"])
    looks: dict[str, Any] = {"look_from": ASIDE} if mount.parent == "base" else {"T_tool0_camera": mount.T}
    policy = ScriptedPolicy(classifier, planner, control_dt=STEP_S * settings["speed"], **looks, **settings["policy"])
    with connected(settings) as (arm, gripper):
        record = PickRecord(Path(settings["output"]), settings)
        picker = Picker(
            arm,
            gripper,
            camera,
            policy,
            workspace,
            speed=settings["speed"],
            ask=None if settings["confirm"] == "no" else agreement.agrees,
            record=record,
            mount=mount,
        )
        act = _look if settings["dry_run"] else _pick
        good = act(picker, policy, record, settings["target"], say)
    say(f"all of it in {record.folder}")
    return good


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
