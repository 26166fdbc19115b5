"""A thing looked at from all around by an arm that carries the camera; nothing is touched."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from grasping import Segmenter
from pecgrasp_env.motion.clearance import path_past
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.policy.perception import View, look
from pecgrasp_env.policy.viewpoints import look_postures, postures_around
from pecgrasp_env.real.errors import Declined
from pecgrasp_env.real.interfaces import Arm
from pecgrasp_env.real.sight import Sight
from pecgrasp_env.real.workspace import Workspace

_PATIENCE_S = 60.0  # of our clock, for one way from view to view


def look_around(
    arm: Arm,
    sight: Sight,
    workspace: Workspace,
    count: int,
    T_tool0_camera: np.ndarray,
    agrees: Callable[[str], bool] = lambda doing: True,
    segmenter: Segmenter | None = None,
) -> Iterator[View]:
    """`count` views at most, the first from above the middle of the table, the others around what it shows.

    The hand stays as it is. Each way is looked up in the workspace before it is begun.
    Raises OutsideWorkspace, Declined, and what stops the arm.
    """
    segmenter = Segmenter() if segmenter is None else segmenter

    def go(path: np.ndarray, doing: str) -> RobotObservation:
        workspace.check_path(path, sight.observe().opening, arm.lengths)
        if not agrees(doing):
            raise Declined(f"stopped before {doing!r}, as was wished")
        arm.move_joints(path[1:]).wait(_PATIENCE_S)
        return sight.observe()

    start = look_postures(T_tool0_camera, arm.lengths)[0]
    view = look(go(np.stack([arm.state.q, start]), "looking, view 1"), segmenter)
    yield view
    place = view.objects[0].centroid if len(view.objects) == 1 else None
    if place is None:
        return
    seen = np.concatenate([view.obstacles, view.objects[0].points])
    for k, posture in enumerate(postures_around(place, count - 1, T_tool0_camera, arm.lengths), start=2):
        path = path_past(seen, view.plane, arm.state.q, posture, arm.lengths)
        yield look(go(path, f"looking, view {k}"), segmenter)
