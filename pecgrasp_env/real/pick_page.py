"""A pick as one HTML file that loads nothing from elsewhere: each frame with what was seen, chosen and planned."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from grasping.viewer.figure import Layer, fragment
from grasping.viewer.html import page, templates
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.pick_drawing import chosen_grasp, planned_way, scene_points, tips_along, words_of
from pecgrasp_env.real.pick_record import decision_of, lines_of, plan_again
from pecgrasp_env.robot.arm_lengths import ArmLengths
from pecgrasp_env.robot.kinematics import UP

_CHOSEN_RGB, _WAY_RGB = (20, 160, 140), (214, 60, 60)
_OTHERS_RGB = ((47, 126, 216), (138, 111, 209), (107, 142, 35), (74, 163, 162), (91, 106, 191))
_POINTS = 12_000  # of a figure


def write_pick_page(
    folder: Path,
    policy: ScriptedPolicy,
    target: str,
    show: Callable[[Mapping[str, Any], PlannedPick], None] = lambda frame, pick: None,
    name: str = "pick.html",
) -> list[dict[str, Any]]:
    """Plan each recorded frame by itself, with today's code, and write the page into the folder.

    show: called with each frame and what was made of it, as a live view wants it. Returns the decisions, one a frame.
    Raises RecordError.
    """
    decisions, frames = [], []
    for frame, pick in plan_again(folder, policy, target):
        show(frame, pick)
        decisions.append(decision_of(pick))
        cloud = scene_points(frame["depth"], frame["intrinsics"], frame["T_base_camera"])
        figure = _figure(pick, cloud)
        frames.append({"lines": lines_of(decisions[-1]), "figure": figure})
    steps = _steps(folder)
    doings = [
        {"doing": doing or "waiting", "steps": len(group), "opening": group[-1]["opening"]}
        for doing, group in ((doing, list(group)) for doing, group in groupby(steps, lambda step: step["doing"]))
    ]
    way = _way_figure(steps, cloud, policy.arm_lengths) if len(steps) > 1 else ""
    body = (
        templates("pecgrasp_env.real")
        .get_template("pick.html")
        .render(
            title=f"{target}, picked" if steps else f"{target}, looked for",
            outcome=_outcome(folder),
            frames=frames,
            doings=doings,
            way=way,
        )
    )
    style = (files("pecgrasp_env.common") / "report.css").read_text(encoding="utf-8")
    (folder / name).write_text(page(f"pick {target}", body, style=style), encoding="utf-8")
    return decisions


def _figure(pick: PlannedPick, cloud: np.ndarray) -> str:
    layers = []
    for k, (seen, words) in enumerate(zip(pick.objects, words_of(pick.objects), strict=True)):
        chosen = k == pick.chosen
        x, y, _ = seen.centroid
        details = (f"{len(seen.points):,} points at x {x:.3f}, y {y:.3f} m",)
        rgb = _CHOSEN_RGB if chosen else _OTHERS_RGB[k % len(_OTHERS_RGB)]
        layers.append(Layer(seen.points, words, details, rgb=rgb, grasp=chosen_grasp(pick) if chosen else None))
    way = planned_way(pick)
    if len(way):
        layers.append(Layer(way, "the fingertips' way", rgb=_WAY_RGB, framed=False))
    return fragment(None, cloud, layers=layers, up=UP, max_points=_POINTS)


def _way_figure(steps: list[dict[str, Any]], cloud: np.ndarray, arm: ArmLengths) -> str:
    layers = []
    for k, (doing, group) in enumerate(groupby(steps, lambda step: step["doing"])):
        moments = list(group)
        points = np.concatenate([tips_along(np.array([step["q"]]), step["opening"], arm)[:1] for step in moments])
        layers.append(Layer(points, doing or "waiting", rgb=_OTHERS_RGB[k % len(_OTHERS_RGB)]))
    return fragment(None, cloud, layers=layers, up=UP, max_points=_POINTS)


def _steps(folder: Path) -> list[dict[str, Any]]:
    file = folder / "steps.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def _outcome(folder: Path) -> list[str]:
    file = folder / "outcome.json"
    if not file.exists():
        return ["A dry run: nothing was moved."]
    told = json.loads(file.read_text())
    lines = [f"try {k}: {failure}" for k, failure in enumerate(told["failures"], start=1)]
    if told["error"] is not None:
        lines.append(": ".join(told["error"]))
    elif told["lifted"]:
        lines.append(f"It was lifted, {1e3 * (told['held_m'] or 0):.0f} mm wide.")
    else:
        lines.append(f"It gave up: {told['reason']}.")
    return [*lines, f"{told['seconds']:.1f} s of the arm's clock."]
