"""A pick while it happens, in a browser: `pip install 'pecgrasp[view]'`, then `view=viser`.

viser rather than rerun-sdk: 9 MB instead of 490, and any browser shows it, also over the network from a computer
without a display; both drew 100,000 points in a tenth of a second. It listens on this machine alone unless told else.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.real.errors import library
from pecgrasp_env.real.pick_drawing import planned_way, scene_points, tips_along, words_of
from pecgrasp_env.robot.kinematics import T_TOOL0_GRIPPER, forward_kinematics

PORT = 8080
_SEEN_RGB, _CHOSEN_RGB, _WAY_RGB = (170, 170, 170), (20, 160, 140), (214, 60, 60)
_EYE, _MIDDLE = (1.15, -0.55, 0.75), (0.5, 0.0, 0.1)  # m, base frame: from where the browser looks first
_MOST_POINTS = 60_000


class LiveView:
    """A page at http://host:port, and what it shows. Raises MissingExtra.

    It is a `pick.Record`, too: `of` says whose thoughts are shown.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = PORT, of: ScriptedPolicy | None = None) -> None:
        viser = library("viser", "view")
        logging.getLogger("websockets.server").setLevel(logging.WARNING)  # each browser that comes is no news
        self._server: Any = viser.ViserServer(host=host, port=port, verbose=False)
        self.address = f"http://{host}:{self._server.get_port()}"
        self._server.initial_camera.position, self._server.initial_camera.look_at = _EYE, _MIDDLE
        self._of = of
        self._doing: Any = self._server.gui.add_markdown("")
        self._views, self._drawn = -1, 0
        self._way: np.ndarray | None = None

    def frame(self, observation: RobotObservation, frame: DepthFrame) -> None:
        """What the camera has just seen."""
        self._cloud(scene_points(frame.depth, frame.intrinsics, observation.T_base_camera))

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None:
        """Where the hand is, and what the policy is about."""
        T = forward_kinematics(observation.q, observation.arm) @ T_TOOL0_GRIPPER
        self._pose("/hand", T)
        if self._of is None:
            return
        log = self._of.log
        if doing and self._doing.content != doing:
            self._doing.content = doing
        if log.views != self._views:
            self._views = log.views
            self._objects(log.objects, log.chosen)
        way = self._of.way
        if way is not None and way is not self._way:
            self._way = way
            self._line(tips_along(way, observation.opening, observation.arm))
        if log.grasp is not None:
            self._pose("/grasp", log.grasp.pose)

    @property
    def doing(self) -> str:
        """What it says that happens."""
        return str(self._doing.content)

    def planned(self, frame: Mapping[str, Any], pick: PlannedPick) -> None:
        """A frame, as `recorded_frames` gives it, and what was made of it."""
        self._cloud(scene_points(frame["depth"], frame["intrinsics"], frame["T_base_camera"]))
        self._objects(pick.objects, pick.chosen)
        self._line(planned_way(pick))
        if pick.T_base_grasp is not None:
            self._pose("/grasp", pick.T_base_grasp)
        self._doing.content = pick.reason or "planned"

    def close(self) -> None:
        self._server.stop()

    def _cloud(self, points: np.ndarray) -> None:
        shown = points[:: 1 + len(points) // _MOST_POINTS].astype(np.float32)
        self._server.scene.add_point_cloud("/scene", shown, _SEEN_RGB, point_size=0.002)

    def _objects(self, objects: Sequence[SeenObject], chosen: int | None) -> None:
        for k in range(len(objects), self._drawn):
            self._server.scene.remove_by_name(f"/objects/{k}")
        self._drawn = len(objects)
        for k, (seen, words) in enumerate(zip(objects, words_of(objects), strict=True)):
            rgb = _CHOSEN_RGB if k == chosen else tuple(int(each) for each in _colour(k))
            points = seen.points.astype(np.float32)
            self._server.scene.add_point_cloud(f"/objects/{k}", points, rgb, point_size=0.003)
            top = seen.centroid + np.array([0.0, 0.0, 0.06])
            self._server.scene.add_label(f"/objects/{k}/words", words, position=tuple(map(float, top)))

    def _line(self, points: np.ndarray) -> None:
        if len(points) > 1:
            pairs = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
            self._server.scene.add_line_segments("/way", pairs, _WAY_RGB)

    def _pose(self, name: str, T: np.ndarray) -> None:
        turn = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        self._server.scene.add_frame(name, wxyz=turn, position=T[:3, 3], axes_length=0.06, axes_radius=0.002)


def _colour(k: int) -> np.ndarray:
    return np.array(((47, 126, 216), (138, 111, 209), (107, 142, 35), (74, 163, 162), (91, 106, 191))[k % 5])
