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

from grasping import ROBOTIQ_2F_140, Grasp
from grasping.viewer.gripper_mesh import gripper_parts
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.real.errors import library
from pecgrasp_env.real.pick_drawing import chosen_grasp, planned_way, scene_points, tips_along, words_of
from pecgrasp_env.real.pick_record import decision_of, lines_of
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import forward_kinematics, tool0_from_grasp

PORT = 8080
_SEEN_RGB, _CHOSEN_RGB, _WAY_RGB = (170, 170, 170), (20, 160, 140), (214, 60, 60)
_EYE, _MIDDLE = (1.15, -0.55, 0.75), (0.5, 0.0, 0.1)  # m, base frame: from where the browser looks first
_MOST_POINTS = 60_000
_PLANNED = 0.45  # opacity of a gripper where it is to be


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
        self._server.scene.add_frame("/base", axes_length=0.1, axes_radius=0.003)
        self._server.scene.add_label("/base/words", "base of the arm")
        self._views, self._drawn = -1, 0
        self._parts: dict[str, Any] = {}
        self._grasp: Grasp | None = None
        self._way: np.ndarray | None = None

    def frame(self, observation: RobotObservation, frame: DepthFrame) -> None:
        """What the camera has just seen."""
        self._cloud(scene_points(frame.depth, frame.intrinsics, observation.T_base_camera))

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None:
        """Where the hand is, and what the policy is about."""
        self._hand(observation.q, observation.opening, observation.arm)
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
        if log.grasp is not None and log.grasp is not self._grasp:
            self._grasp = log.grasp
            self._gripper("/grasp", log.grasp.pose, log.grasp.width, _PLANNED)

    @property
    def doing(self) -> str:
        """What it says that happens."""
        return str(self._doing.content)

    def planned(self, frame: Mapping[str, Any], pick: PlannedPick) -> None:
        """A frame, as `recorded_frames` gives it, and what was made of it."""
        self._hand(frame["q"], frame["opening"], UR5 if self._of is None else self._of.arm_lengths)
        self._cloud(scene_points(frame["depth"], frame["intrinsics"], frame["T_base_camera"]))
        self._objects(pick.objects, pick.chosen)
        self._line(planned_way(pick))
        grasp = chosen_grasp(pick)
        if grasp is not None:
            self._gripper("/grasp", grasp.pose, grasp.width, _PLANNED)
        for name, part in self._parts.items():
            part.visible = grasp is not None or not name.startswith("/grasp/")
        self._doing.content = "\n\n".join(lines_of(decision_of(pick)))

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
        if len(points) < 2:
            self._server.scene.remove_by_name("/way")
        else:
            pairs = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
            self._server.scene.add_line_segments("/way", pairs, _WAY_RGB)

    def _hand(self, q: np.ndarray, opening: float, arm: ArmLengths) -> None:
        T_tool0_grasp = np.linalg.inv(tool0_from_grasp(np.eye(4), opening))
        self._gripper("/hand", forward_kinematics(q, arm) @ T_tool0_grasp, opening, 1.0)

    def _gripper(self, name: str, T_base_grasp: np.ndarray, opening: float, opacity: float) -> None:
        """To scale, with its pads at that opening, m; drawn once, then moved."""
        for part in gripper_parts(ROBOTIQ_2F_140, opening):
            T = T_base_grasp @ part.T_grasp_part
            turn = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
            key = f"{name}/{part.name}"
            if key in self._parts:
                self._parts[key].wxyz, self._parts[key].position = turn, T[:3, 3]
                continue
            mesh = part.vertices.astype(np.float32), part.faces.astype(np.uint32)
            shown = {"color": part.rgb, "flat_shading": True, "opacity": opacity if opacity < 1 else None}
            self._parts[key] = self._server.scene.add_mesh_simple(key, *mesh, **shown, wxyz=turn, position=T[:3, 3])


def _colour(k: int) -> np.ndarray:
    return np.array(((47, 126, 216), (138, 111, 209), (107, 142, 35), (74, 163, 162), (91, 106, 191))[k % 5])
