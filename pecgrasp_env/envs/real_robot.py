"""SelectiveGraspReal-v1: the task on a robot of one's own, so that an agent from the simulation is tried on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from scipy.spatial.transform import Rotation

from pecgrasp_env.envs.cloud_observation import sample_cloud_of_frame
from pecgrasp_env.envs.observation_bounds import bounded
from pecgrasp_env.envs.real_actions import CONTROL_MODES, OutOfReach, action_space, gripper_target, joint_targets
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.real.connected import Agreement
from pecgrasp_env.real.errors import Declined, RobotError
from pecgrasp_env.real.interfaces import Arm, DepthCamera, ParallelGripper
from pecgrasp_env.real.sight import Sight
from pecgrasp_env.real.workspace import OutsideWorkspace, Workspace, hand_points
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.camera_mount import BRACKET, CameraMount
from pecgrasp_env.robot.kinematics import T_TOOL0_TCP, forward_kinematics, home
from pecgrasp_env.sensor.intrinsics import FAR

OBS_MODES = ("depth", "cloud")
CLASSES = ("joypad", "mouse", "pliers", "stapler", "plug_adapter")  # the LARS five, as in the simulation
CONTROL_S = 0.05
_PATIENCE_S = 20.0  # of our clock, for one step
_HOMING_S = 60.0
_LIFTED_M = 0.15  # of the fingertips above the table
_GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])


class RealTaskError(ValueError):
    """An argument of the environment makes no sense with a real robot; the message names it."""


@dataclass(frozen=True)
class RealRobot:
    """What the environment drives: any `Arm`, `ParallelGripper` and `DepthCamera` (`pecgrasp_env.real.interfaces`).

    mount: where the camera is. workspace: what flange and fingertips stay in. speed: of the fingers, m/s.
    """

    arm: Arm
    gripper: ParallelGripper
    camera: DepthCamera
    mount: CameraMount = BRACKET
    workspace: Workspace = field(default_factory=Workspace)
    speed: float = 0.1


class SelectiveGraspRealEnv(gym.Env):
    """
    ## Description
    SelectiveGraspSingle-v1 on a real arm: the same numbers in, the same numbers out, as far as a real robot has them.
    Needs no simulator. Nothing is known of the objects: who or what looks decides what is right.

    ## Action Space
    That of SelectiveGraspSingle-v1 in the same `control_mode`, all four. A target is looked up in the workspace and
    among the joint limits first; one outside is not sent, the arm stays, and `info["refused"]` says why. The arm's own
    `speed` bounds every step: one that asks for more takes longer than 0.05 s.

    ## Observation Space
    That of SelectiveGraspSingle-v1 with `obs_mode` "depth" or "cloud", the same `classes` and the resolution of the
    camera. `agent/qvel` is the arm's own and 0 of the gripper; `extra/force` the force that the gripper was told
    while it holds something, else 0: a 2F-140 measures none. Both pads stand as the opening says.

    ## Rewards
    1 in the step in which something is held up, else 0.

    ## Starting State
    `reset` asks (`confirm`, `ask`) before it opens the gripper and before it brings the arm to the home posture;
    without a yes nothing moves and `Declined` is raised. `options={"target": name}` or `target` says what is asked for;
    else a class is drawn. Objects are laid out by people.

    ## Episode End
    Terminated where something is held with the fingertips 0.15 m above the table: `info["lifted"]`; whether it is the
    right thing is not known. Truncated after 400 steps, and where the arm, the gripper or the camera fails:
    `info["error"]` is the class of the error, `info["reason"]` its message. After that `step` raises it again;
    `reset` asks whether to recover.

    ## Arguments
    `robot` (a `RealRobot`), `obs_mode` ("depth"), `control_mode` ("pd_ee_delta_pose"), `classes` (the LARS five),
    `target` (None: drawn), `cloud_points` (1024), `confirm` ("each", "once", "no"), `ask` (words → bool; the keyboard).

    ## Version History
    - v1: first version.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        robot: RealRobot,
        *,
        obs_mode: str = "depth",
        control_mode: str = "pd_ee_delta_pose",
        classes: Sequence[str] = CLASSES,
        target: str | None = None,
        cloud_points: int = 1024,
        confirm: str = "each",
        ask: Callable[[str], bool] | None = None,
        render_mode: None = None,
    ) -> None:
        if not isinstance(robot, RealRobot):
            raise RealTaskError(f"robot={robot!r}: RealRobot(arm, gripper, camera) is wanted")
        if obs_mode not in OBS_MODES:
            raise RealTaskError(
                f"obs_mode={obs_mode!r}: one of {', '.join(OBS_MODES)}; only a simulation knows where the objects are"
            )
        if control_mode not in CONTROL_MODES:
            raise RealTaskError(f"control_mode={control_mode!r}: one of {', '.join(CONTROL_MODES)}")
        self.classes = tuple(classes)
        self._target_name = self._checked_target(target) if target is not None else None
        self._robot, self._obs_mode, self._control_mode = robot, obs_mode, control_mode
        self._cloud_points = cloud_points
        self._agreement = Agreement(confirm, _typed if ask is None else ask)
        self._sight = Sight(robot.arm, robot.gripper, robot.camera, robot.mount)
        self._told = np.array([linkage.STROKE, linkage.MAX_FORCE])
        self._holding = False
        self._error: RobotError | None = None
        self._steps, self._episode, self.target = 0, 0, self.classes[0]
        self.action_space = action_space(control_mode)
        self.observation_space = self._observation_space()

    # ------------------------------------------------------------ Gymnasium

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """To the home posture, after a yes. Raises Declined, RealTaskError, and what stops the arm."""
        super().reset(seed=seed)
        options = dict(options or {})
        wanted = options.pop("target", self._target_name)
        if options:
            raise RealTaskError(f"options: no option {next(iter(options))!r}, there is 'target'")
        drawn = self.classes[int(self.np_random.integers(len(self.classes)))]
        self.target = drawn if wanted is None else self._checked_target(wanted)
        self._episode, self._steps = int(self.np_random.integers(2**31)), 0
        self._make_ready()
        self._go_home()
        self._holding = False
        return self._observed(), self._info()

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Raises what stopped the arm in a step before, until `reset`."""
        if self._error is not None:
            raise self._error
        action = np.asarray(action, float)
        if action.shape != (8,) or not np.isfinite(action).all():
            raise ValueError(f"action must be (8,) finite numbers, got {action.tolist()}")
        self._steps += 1
        refused, truncated = "", False
        try:
            refused = self._act(np.clip(action, self.action_space.low, self.action_space.high))
            self._holding = bool(self._robot.gripper.is_holding)
            self._last = self._observed()
        except RobotError as error:
            self._error, truncated = error, True
            self._stop()
        lifted = not truncated and self._holding and self._tips() > _LIFTED_M
        info = self._info() | {"lifted": lifted, "refused": refused}
        if self._error is not None:
            info |= {"error": type(self._error).__name__, "reason": str(self._error)}
        return self._last, float(lifted), lifted, truncated, info

    def close(self) -> None:
        """The robot stays the caller's, who closes it."""

    # ------------------------------------------------------------ moving

    def _make_ready(self) -> None:
        if self._error is None:
            return
        if not self._agreement.agrees(f"make the arm ready again after {type(self._error).__name__}: {self._error}"):
            raise Declined("not made ready again, as was wished")
        self._robot.arm.recover()
        self._error = None

    def _go_home(self) -> None:
        """Nothing is done where everything stands there already."""
        arm, gripper = self._robot.arm, self._robot.gripper
        try:
            if gripper.width < 0.97 * linkage.STROKE:
                self._agreed("open the gripper")
                gripper.move(linkage.STROKE, self._robot.speed, self._force(linkage.MIN_FORCE)).wait(_PATIENCE_S)
            self._told = np.array([linkage.STROKE, linkage.MAX_FORCE])
            if np.abs(arm.state.q - home(arm.lengths)).max() > 0.005:
                self._agreed("move to the home posture")
                arm.move_joints(home(arm.lengths)).wait(_HOMING_S)
        except Declined:
            raise
        except RobotError as error:
            self._error = error
            raise

    def _agreed(self, doing: str) -> None:
        if not self._agreement.agrees(doing):
            raise Declined(f"stopped before {doing!r}, as was wished")

    def _act(self, action: np.ndarray) -> str:
        """Send one step; why the arm's part of it was not, or ""."""
        arm, gripper = self._robot.arm, self._robot.gripper
        q_now = arm.state.q
        opening, force = gripper_target(self._control_mode, action[6:])
        force = self._force(force)
        if np.abs(self._told - (opening, force)).max() > 1e-3 or abs(self._told[0] - opening) > 3e-4:
            gripper.move(opening, self._robot.speed, force)
            self._told = np.array([opening, force])
        try:
            q = joint_targets(self._control_mode, action[:6], q_now, arm.lengths)
            opening = float(np.clip(gripper.width, 0.0, linkage.STROKE))
            self._robot.workspace.check_path(np.stack([q_now, q]), opening, arm.lengths)
        except (OutsideWorkspace, OutOfReach) as error:
            q, refused = q_now, str(error)
        else:
            refused = ""
        arm.follow(q, CONTROL_S).wait(_PATIENCE_S)
        return refused

    def _force(self, force: float) -> float:
        return min(force, self._robot.workspace.max_force)

    def _stop(self) -> None:
        """Where it cannot be told so it stands still by itself: nothing is sent to it any more."""
        with suppress(RobotError):
            self._robot.arm.stop()

    # ------------------------------------------------------------ seeing

    def _observed(self) -> dict[str, Any]:
        seen = self._sight.observe()
        tcp = forward_kinematics(seen.q, seen.arm) @ T_TOOL0_TCP
        turn = Rotation.from_matrix(tcp[:3, :3]).as_quat(scalar_first=True)
        crank = float(linkage.crank_joint(seen.opening))
        agent = {
            "qpos": np.array([*seen.q, *[crank] * 4], np.float32),
            "qvel": np.array([*self._robot.arm.state.qd, *[0.0] * 4], np.float32),
            "controller": {
                "gripper": {
                    "target_opening": self._told[:1].astype(np.float32),
                    "force_limit": self._told[1:].astype(np.float32),
                }
            },
        }
        extra = {
            "target": np.eye(len(self.classes), dtype=np.float32)[self.classes.index(self.target)],
            "tcp_pose": np.concatenate([tcp[:3, 3], turn]).astype(np.float32),
            "opening": np.array([seen.opening], np.float32),
            "force": np.array([self._told[1] if self._holding else 0.0], np.float32),
        }
        return {"agent": agent, "extra": extra} | (
            self._depth(seen) if self._obs_mode == "depth" else self._cloud(seen)
        )

    def _depth(self, seen: RobotObservation) -> dict[str, Any]:
        depth, intrinsics = seen.frame
        T = seen.T_base_camera
        images = {"depth": np.clip(np.nan_to_num(depth), 0.0, FAR).astype(np.float32)[..., None]}
        camera = {
            "extrinsic_cv": np.linalg.inv(T)[:3].astype(np.float32),
            "cam2world_gl": (T @ _GL_FROM_CV).astype(np.float32),
            "intrinsic_cv": intrinsics.matrix.astype(np.float32),
        }
        return {"sensor_data": {"wrist_camera": images}, "sensor_param": {"wrist_camera": camera}}

    def _cloud(self, seen: RobotObservation) -> dict[str, Any]:
        depth, intrinsics = seen.frame
        n = self._cloud_points
        return {"cloud": sample_cloud_of_frame(depth, intrinsics, seen.T_base_camera, self._episode, self._steps, n)}

    def _observation_space(self) -> spaces.Space:
        """Of one look: nothing moves."""
        self._last = self._observed()
        return bounded(_free(self._last), 1 / CONTROL_S)

    def _tips(self) -> float:
        """Height of the lowest fingertip above the table, m."""
        arm, opening = self._robot.arm, float(np.clip(self._robot.gripper.width, 0.0, linkage.STROKE))
        points = hand_points(arm.state.q, opening, arm.lengths)
        return float(points[1:, 2].min()) - self._robot.workspace.table

    def _info(self) -> dict[str, Any]:
        return {"target": self.target, "holding": self._holding, "elapsed_steps": self._steps}

    def _checked_target(self, name: str) -> str:
        if name not in self.classes:
            raise RealTaskError(f"target={name!r}: must be one of {', '.join(self.classes)}")
        return name


def _free(value: Any) -> spaces.Space:
    """The space of an observation, without bounds."""
    if isinstance(value, dict):
        return spaces.Dict({key: _free(inner) for key, inner in value.items()})
    return spaces.Box(-np.inf, np.inf, value.shape, np.float32)


def _typed(doing: str) -> bool:
    try:
        return input(f"{doing}? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False
