"""`pecgrasp pick` and `pecgrasp replay-pick` from their settings: plain values in, lines for people out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.policy.viewpoints import aside
from pecgrasp_env.real.connected import Agreement, SettingError, connected, mount_of_setting, workspace_of
from pecgrasp_env.real.interfaces import DepthCamera
from pecgrasp_env.real.live_view import LiveView
from pecgrasp_env.real.pick import STEP_S, Picker, Record, Records
from pecgrasp_env.real.pick_page import write_pick_page
from pecgrasp_env.real.pick_record import PickRecord, decision_of, lines_of, recorded_settings
from pecgrasp_env.real.ur_measured import words_of

Say = Callable[[str], None]


def run_pick(
    settings: dict[str, Any], camera: DepthCamera, classifier: Any, planner: Any, ask: Callable[[str], bool], say: Say
) -> bool:
    """One pick, or one look; whether it went as it should.

    settings: those of conf/pick.yaml. ask: whether the user agrees to a motion, in words.
    """
    agreement = Agreement(settings["confirm"], ask)
    workspace, mount = workspace_of(settings["workspace"]), mount_of_setting(settings["calibration"])
    with connected(settings) as (arm, gripper):
        say(words_of(arm.lengths))
        looks: dict[str, Any] = {"T_tool0_camera": mount.T}
        if mount.parent == "base":
            looks = {"look_from": aside(arm.lengths)}
        policy = ScriptedPolicy(
            classifier,
            planner,
            control_dt=STEP_S * settings["speed"],
            arm=arm.lengths,
            **looks,
            **settings["policy"],
        )
        with view_of(settings, policy, say) as view:
            measured = arm.lengths.measured
            told = {"measured_lengths": None if measured is None else measured.tolist()}
            record = PickRecord(Path(settings["output"]), settings | told)
            records: Record = record if view is None else Records(record, view)
            picker = Picker(
                arm,
                gripper,
                camera,
                policy,
                workspace,
                speed=settings["speed"],
                ask=None if settings["confirm"] == "no" else agreement.agrees,
                record=records,
                mount=mount,
            )
            good = (
                _look(picker, policy, record, settings["target"], say, view)
                if settings["dry_run"]
                else _pick(picker, policy, record, settings["target"], say)
            )
            write_pick_page(record.folder, policy, settings["target"])
            say(f"all of it in {record.folder}; to look at: pick.html")
            if view is not None:
                ask(f"close the view at {view.address}")
    return good


@contextmanager
def view_of(settings: dict[str, Any], policy: ScriptedPolicy | None, say: Say) -> Iterator[LiveView | None]:
    """Of the settings view, view_host and view_port. Raises SettingError, MissingExtra."""
    if settings["view"] not in (None, "viser"):
        raise SettingError(f"view={settings['view']}: must be null or viser")
    if settings["view"] is None:
        yield None
        return
    view = LiveView(settings["view_host"], int(settings["view_port"]), policy)
    say(f"live: {view.address}")
    try:
        yield view
    finally:
        view.close()


def _look(
    picker: Picker, policy: ScriptedPolicy, record: PickRecord, target: str, say: Say, view: LiveView | None
) -> bool:
    observation = picker.observe()
    frame = observation.frame
    pick = policy.plan_only(
        frame.depth, frame.intrinsics, observation.T_base_camera, target, q=observation.q, opening=observation.opening
    )
    decision = decision_of(pick)
    record.decided(decision)
    if view is not None:
        moment = {"T_base_camera": observation.T_base_camera, "q": observation.q, "opening": observation.opening}
        view.planned(frame._asdict() | moment, pick)
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


def run_replay(
    folder: Path, target: str | None, policy: ScriptedPolicy, say: Say, view: LiveView | None = None
) -> list[dict[str, Any]]:
    """Each recorded frame of a run, planned again, and the run's page; what was decided, frame by frame.

    Raises RecordError.
    """
    target = target or str(recorded_settings(folder)["target"])
    decisions = write_pick_page(folder, policy, target, _nowhere if view is None else view.planned, "replayed.html")
    for k, decision in enumerate(decisions):
        say(f"frame {k}")
        for line in lines_of(decision):
            say(f"  {line}")
    return decisions


def _nowhere(frame: Any, pick: Any) -> None:
    """Shown in no live view."""
