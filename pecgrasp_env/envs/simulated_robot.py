"""SelectiveGrasp-v1's robot and table as something that joint targets move at 100 Hz, for stand-ins of a real robot.

The task judges at its own 20 Hz, as in any episode; between two of its steps the arm gets further targets.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import sapien
import torch

from pecgrasp_env.envs.selective_grasp import SelectiveGraspEnv
from pecgrasp_env.policy.observation import read_observation
from pecgrasp_env.robot.arm_lengths import UR5
from pecgrasp_env.sensor.d435_noise import apply_ideal
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics
from pecgrasp_env.sensor.sapien_depth import SAPIEN_FROM_OPENCV, add_depth_camera, take_depth

_UP_M = 0.02  # of what is held
# Of what the task says, what is told to others.
_JUDGED = {"success", "wrong_object", "off_table", "dropped", "stranger_lifted", "disturbance_m", "visible_share"}


class SimulatedRobot:
    """One episode after the other. kwargs: those of SelectiveGrasp-v1.

    period: s. arm: a UR5's lengths, which is what the scene has. target: the asked-for class. outcome: how the episode
    has ended, "success", "wrong_object" or "off_table"; None before that. judged: what the task said of it last, at its
    end the last time.
    """

    def __init__(self, seed: int = 0, **kwargs: Any) -> None:
        env = gym.make(
            "SelectiveGrasp-v1", control_mode="pd_joint_pos", obs_mode="depth", sim_backend="physx_cpu", **kwargs
        )
        self.task: SelectiveGraspEnv = env.unwrapped
        self.task.pictures_on_demand = True
        self.arm = UR5
        self.period = 1.0 / self.task.sim_freq
        self._every = self.task.sim_freq // self.task.control_freq
        self.reset(seed)
        self.grab()  # the first picture takes long

    def reset(self, seed: int) -> None:
        """A new episode: new objects, the arm in its home posture."""
        _, info = self.task.reset(seed=seed)
        self._beside: Any = None  # a camera of this episode's scene that stands beside the robot
        self.target = str(info["target"][0])
        self._lay = [actor.pose.sp for actor in self.task.objects]
        self.outcome: str | None = None
        self.judged: dict[str, float] = {}
        self._steps = 0

    @property
    def q(self) -> np.ndarray:
        """(6,) rad, measured."""
        return self.task.agent.robot.get_qpos()[0, :6].cpu().numpy().astype(float)

    @property
    def opening(self) -> float:
        """m, measured."""
        return float(self.task.agent.gripper_opening[0])

    def step(self, q: np.ndarray, opening: float, force: float) -> None:
        """One period with joint targets (6,) rad, opening m and grip force N; the last two count every fifth time."""
        agent = self.task.agent
        if self._steps % self._every == 0:
            if self._steps and self.outcome is None:
                self._judge()
            agent.set_action(torch.tensor([[*q, opening, force]], dtype=torch.float32))
            self.task._before_control_step()
        else:
            agent.controller.controllers["arm"].set_action(torch.tensor(q[None], dtype=torch.float32))
        agent.before_simulation_step()
        self.task.scene.step()
        self._steps += 1

    def _judge(self) -> None:
        self.task._elapsed_steps += 1
        info = self.task.evaluate()
        self.judged = {name: float(value[0]) for name, value in info.items() if name in _JUDGED}
        for name in ("success", "wrong_object", "off_table"):
            if bool(info[name]):
                self.outcome = name
                return

    def grab(self, T_base_camera: np.ndarray | None = None) -> tuple[np.ndarray, CameraIntrinsics]:
        """Depth (H, W), m, and intrinsics, of the wrist camera or, without noise, of one at T_base_camera (4, 4)."""
        if T_base_camera is not None:
            return self._grab_from(T_base_camera)
        return tuple(read_observation(self.task.get_obs(self.task.get_info())).frame)  # type: ignore[return-value]

    def _grab_from(self, T_base_camera: np.ndarray) -> tuple[np.ndarray, CameraIntrinsics]:
        intrinsics = self.task.sensing.intrinsics
        if self._beside is None:
            self._beside = add_depth_camera(self.task.scene.sub_scenes[0], intrinsics)
        T = np.array(T_base_camera, float)
        T[:3, :3] = T[:3, :3] @ SAPIEN_FROM_OPENCV.T
        self._beside.entity.set_pose(sapien.Pose(T))
        self.task.scene.update_render()
        return apply_ideal(take_depth(self._beside), intrinsics), intrinsics

    def drop(self) -> None:
        """What is up lies again where it lay at the start."""
        for actor, lay in zip(self.task.objects, self._lay, strict=True):
            if float(actor.pose.p[0, 2]) > lay.p[2] + _UP_M:
                _lay_down(actor, lay)

    def swap(self) -> None:
        """The asked-for object and the nearest of another class have changed places, each turned as it lay. Raises
        ValueError where there is none.
        """
        classes = [model.class_name for model in self.task.models[0]]
        one = classes.index(self.target)
        at = [np.array(lay.p[:2]) for lay in self._lay]
        others = [k for k, name in enumerate(classes) if name != self.target]
        if not others:
            raise ValueError(f"nothing but the {self.target} lies there: env.n_objects=2 or more")
        other = min(others, key=lambda k: float(np.linalg.norm(at[k] - at[one])))
        for k, place in ((one, at[other]), (other, at[one])):
            _lay_down(self.task.objects[k], sapien.Pose([*place, self._lay[k].p[2]], self._lay[k].q))

    def report(self) -> dict[str, object]:
        """What is asked for, how the episode ended, what lies there and where, (K, 3) m, base frame."""
        models = self.task.models[0]
        return {
            "target": self.target,
            "outcome": self.outcome,
            "judged": self.judged,
            "classes": [model.class_name for model in models],
            "instances": [model.instance for model in models],
            "places": [actor.pose.p[0].tolist() for actor in self.task.objects],
        }


def _lay_down(actor: Any, pose: sapien.Pose) -> None:
    """At rest there."""
    actor.set_pose(pose)
    actor.set_linear_velocity(torch.zeros(3))
    actor.set_angular_velocity(torch.zeros(3))
