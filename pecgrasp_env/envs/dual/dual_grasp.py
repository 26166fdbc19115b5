"""DualGrasp-v1: two UR5 with Robotiq 2F-140 lift one long or heavy thing level and carry it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import sapien
import torch
import trimesh
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils import sapien_utils
from mani_skill.utils.registration import register
from mani_skill.utils.structs.pose import Pose
from mani_skill.utils.structs.types import DefaultMaterialsConfig, SceneConfig, SimConfig

from pecgrasp_env.envs import reward, validation
from pecgrasp_env.envs.contacts import pad_forces, pads_centre, squeeze
from pecgrasp_env.envs.dual import state as outcome
from pecgrasp_env.envs.dual.options import DualOptions, check_one_scene
from pecgrasp_env.envs.dual.placement import draw_start
from pecgrasp_env.envs.registration import MAX_EPISODE_STEPS
from pecgrasp_env.envs.task_state import air_below, batched, unflatten
from pecgrasp_env.envs.validation import SensingOptions, TaskError, take
from pecgrasp_env.envs.words import Words
from pecgrasp_env.envs.wrist_camera_env import NOISE, WristCameraEnv
from pecgrasp_env.objects.procedural.for_two_arms.draw import KINDS, draw_large
from pecgrasp_env.robot.agent import UR5Robotiq2F140, gripper_qpos
from pecgrasp_env.robot.gripper_linkage import STROKE
from pecgrasp_env.robot.pad_contact import both_press, outward
from pecgrasp_env.robot.two_arm_bases import MIDDLE, T_WORLD_BASE, WAITING
from pecgrasp_env.robot.two_arms import TwoArms
from pecgrasp_env.scene import table as workbench
from pecgrasp_env.scene.actors import MAX_DEPENETRATION_SPEED
from pecgrasp_env.scene.settling import CONTACT_OFFSET_M

CAMERA = "stand_camera"
_RESOLUTION = "640x480"
_EYE, _AIM = (MIDDLE[0], -0.30, 1.05), (MIDDLE[0], 0.02, 0.0)  # m, world frame: into an open crate, past both hands
_TABLE_X = (-0.30, 1.20)  # m, under both bases
_SURFACE_POINTS = 400  # that stand for the object where its distance from a hand is told

# Streams of random numbers of one episode.
_CHOICE, _LAYOUT = 0, 1


class DualGraspEnv(WristCameraEnv):
    """
    ## Description
    One long or heavy thing lies between two arms: a board, an open crate with a load at one end, a hammer with a long
    handle. It has to be lifted by both, kept level, and carried to where a displacement says: up, and sideways.

    The world frame is the first robot's base frame: z up, tabletop at z = 0. The second robot stands opposite, 0.90 m
    away along x, turned by half a turn. Lengths in metres, angles in radians, quaternions w, x, y, z. Control at 20 Hz,
    physics at 100 Hz. Friction, grip force, torque limits and gripper are those of SelectiveGrasp-v1.

    ## Action Space
    `Box(16,)` float32: the eight numbers of SelectiveGrasp-v1's control modes (`pd_joint_pos`, `pd_joint_delta_pos`,
    `pd_ee_pose`, `pd_ee_delta_pose`; six for the arm, opening, force limit) for the first arm, then for the second. Of
    the second, poses are in the frame of its own base.

    ## Observation Space
    In the mode `state_dict` (`state` is the same, flattened), first axis the sub-environment; all limits are finite:
    | key | shape | unit, frame | meaning |
    |---|---|---|---|
    | agent/arm_0, agent/arm_1 | | | of each arm `qpos`, `qvel`, `controller` as `agent` of SelectiveGrasp-v1 |
    | extra/goal | (3,) | m; world | how far the thing is to be carried from where it lay at the start |
    | extra/tcp_poses | (14,) | m, wxyz; world | of both fixed tool points |
    | extra/openings | (2,) | m | measured gripper openings |
    | extra/forces | (2,) | N | measured grip forces, mean of both pads along the closing axis, 0 … 250 |
    | extra/object_pose | (7,) | m, wxyz; world | in state modes only: its centre of mass and how it is turned |

    `cloud`, and ManiSkill's visual modes, are as in SelectiveGrasp-v1, of one camera, `stand_camera`: a D435 on a stand
    beside the table, 1.05 m above it, which looks down past both hands. The cameras on the hands show nothing.

    ## Rewards
    `sparse`: 1 on success, −1 on failure, else 0. `dense`, per step: what the step has added to a potential, and 5 or
    −1 for how the episode ended, as in SelectiveGrasp-v1; `normalized_dense` is a fifth of it.
    | term of the potential | range |
    |---|---|
    | reach: mean over both hands of 1 − tanh(5 · distance from the pads' centre to the thing's surface in m) | 0 … 1 |
    | grasp: share of the hands that hold it | 0, ½, 1 |
    | carry: share of the way to the goal, while both hold it | 0 … 1 |
    | still: 1 − tanh(10 · its speed in m/s), while both hold it at the goal | 0 … 1 |

    ## Starting State
    A kind out of `kinds`, its shape and its weight are drawn: 1 to 6 kg of one density throughout, 0.38 to 0.85 m long.
    It rests on the table, its middle within 0.03 m of the middle between the arms along x and 0.05 m along y, its long
    axis within 40° of the line across. Both arms wait beside the table's middle, ± `joint_noise`. The goal is 0.15 to
    0.22 m up and 0.05 to 0.10 m sideways in any direction. All is drawn by the episode's seed; each has a new object.

    ## Episode End
    Terminated on success: both hands hold it (both pads of each press on it), it is within 0.03 m of the goal and
    slower than 0.02 m/s, and never in the episode was it tilted by 10° or more against how it rested. Terminated on
    failure: `tilted`, `off_table`, or `overloaded`: a hand has borne more than an arm's payload for 0.2 s, at which a
    UR5 stops: 5 kg at its flange, 1.1 kg of it the hand's. Truncated after 400 steps. To put it down again, `dropped`,
    is no failure.

    `info`, one value a sub-environment:
    | key | meaning |
    |---|---|
    | success, fail | as above |
    | carried_level | as success, whether one hand holds it or two |
    | tilted, off_table | its worst tilt has reached 10°; it has left the table |
    | overloaded | as above, also without `protective_stop` |
    | dropped | it had 0.05 m of air under it and is down again |
    | tilt, worst_tilt | angle against how it rested, now and at its worst, rad |
    | height | air under its lowest point, m |
    | holds | (2,) of each hand, whether both its pads press on it |
    | loads | (2,) what of its weight each hand bears in the air, N, by the lever rule; PhysX does not tell friction |
    | mass | kg |
    | centre_of_mass | (3,) m, world frame |
    | goal_distance, speed | m from where it is to be, m/s |
    | distances | (2,) m from each hand's pads' centre to its surface |
    | object | its name, a word: kind and seed |
    | planner_reason | what was last given to `set_planner_reason` in this episode, or "" |

    ## Arguments
    | name | default | meaning |
    |---|---|---|
    | `kinds` | ("board", "crate", "long_tool") | what may lie there |
    | `protective_stop` | True | whether an overloaded arm ends the episode; the simulated arms alone would go on |
    | `joint_noise` | 0.02 | greatest deviation of each arm joint from the waiting posture at the start, rad |
    | `sensor` | "ideal" | as in SelectiveGrasp-v1 |
    | `resolution` | "640x480" | depth mode of the D435 |
    | `cloud_points` | 1024 | points of the observation mode `cloud` |

    and those of `mani_skill.envs.sapien_env.BaseEnv` but `robot_uids`; one scene on a CPU. Arguments that make no sense
    raise `TaskError` or `SensorError`, unknown ones `TypeError`. A state (`get_state_dict`, `get_state`) holds the
    task's memory, too; it fits the object of its own episode. `DualGraspSingle-v1` is the same without the batch axis.

    ## Version History
    - v1: first version.
    """

    SUPPORTED_ROBOTS = ((UR5Robotiq2F140.uid, UR5Robotiq2F140.uid),)
    SUPPORTED_REWARD_MODES = ("normalized_dense", "dense", "sparse", "none")
    camera_name: ClassVar[str] = CAMERA
    agent: TwoArms
    memory: outcome.DualMemory

    def __init__(
        self,
        *args: Any,
        obs_mode: str | None = None,
        sensor_configs: Mapping[str, Any] | None = None,
        num_envs: int = 1,
        sim_backend: str = "auto",
        **kwargs: Any,
    ) -> None:
        """kwargs: fields of `DualOptions` and `SensingOptions` by name, and ManiSkill's."""
        self.layout = take(DualOptions, kwargs)
        self.sensing = take(SensingOptions, kwargs := {"resolution": _RESOLUTION, **kwargs})
        validation.check_base_arguments(BaseEnv, kwargs, "DualGrasp", (DualOptions, SensingOptions))
        if "robot_uids" in kwargs:
            raise TaskError(f"robot_uids={kwargs['robot_uids']!r}: the task is for two UR5 with 2F-140; leave it out")
        if kwargs.get("render_backend", "gpu") is None:
            kwargs["render_backend"] = "none"
        validation.check_obs_mode(obs_mode, kwargs.get("render_backend", "gpu"))
        check_one_scene(num_envs, sim_backend)
        cameras = self._camera_arguments(obs_mode, None, sensor_configs)
        validation.claim_process()
        super().__init__(
            *args,
            robot_uids=self.SUPPORTED_ROBOTS[0],
            obs_mode="depth" if self._only_cloud else obs_mode,
            sensor_configs=cameras,
            num_envs=1,
            sim_backend="physx_cpu",
            reconfiguration_freq=kwargs.pop("reconfiguration_freq", 1),
            **kwargs,
        )

    # ------------------------------------------------------------------ scene

    @property
    def _default_sim_config(self) -> SimConfig:
        materials = DefaultMaterialsConfig(static_friction=0.6, dynamic_friction=0.6)
        return SimConfig(
            default_materials_config=materials,
            scene_config=SceneConfig(contact_offset=CONTACT_OFFSET_M, enable_pcm=True),
        )

    @property
    def _default_sensor_configs(self) -> CameraConfig:
        camera = self._intrinsics
        pose = sapien_utils.look_at(_EYE, _AIM)
        return CameraConfig(CAMERA, pose, camera.width, camera.height, None, 0.05, 10.0, camera.matrix)

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:
        pose = sapien_utils.look_at([1.20, -1.15, 0.95], [0.45, 0.0, 0.15])
        return CameraConfig("render_camera", pose, 640, 480, 0.80, 0.05, 60)

    def _load_agent(self, options: dict) -> None:
        with warnings.catch_warnings():
            # ManiSkill's passive controller casts a box without numbers.
            warnings.filterwarnings("ignore", message=".*precision lowered by casting")
            super()._load_agent(options, [sapien.Pose(T) for T in T_WORLD_BASE])
        self.agent = TwoArms(self.agent.agents)

    def _load_lighting(self, options: dict) -> None:
        workbench.light(self.scene, shadow=self.enable_shadow)

    def _load_scene(self, options: dict) -> None:
        workbench.build_table(self.scene, x=_TABLE_X)
        workbench.build_floor(self.scene)
        rng = self._generator(_CHOICE)
        kind, number = str(rng.choice(list(self.layout.kinds))), int(rng.integers(2**31))
        self.model = draw_large(kind, number)
        builder = self.model.add_to(self.scene.create_actor_builder())
        builder.initial_pose = sapien.Pose([*MIDDLE, 0.5])
        self.object = builder.build(name="object")
        for body in self.object._bodies:
            body.max_depenetration_velocity = MAX_DEPENETRATION_SPEED
        hull = np.concatenate(self.model.hulls)
        self._hull = torch.tensor(hull, dtype=torch.float32, device=self.device)[None, None]
        surface, _ = trimesh.sample.sample_surface(self.model.visual_mesh(), _SURFACE_POINTS, seed=0)
        self._surface = torch.tensor(np.asarray(surface), dtype=torch.float32, device=self.device)
        drawn = (torch.tensor([value], device=self.device) for value in (KINDS.index(kind), number))
        self.memory = outcome.DualMemory.empty(*drawn)
        self._planner_reason = ""

    # ---------------------------------------------------------------- episode

    def _generator(self, stream: int) -> np.random.Generator:
        """A generator of the episode's own, one for each purpose."""
        return np.random.default_rng([stream, self._batched_episode_rng.rngs[0].randint(2**31)])

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict) -> None:
        self._set_scene_config()  # the private scene of the fall takes the physics engine's current settings
        start = draw_start(self.model, self._generator(_LAYOUT), self.layout.joint_noise)
        placed = torch.tensor(start.pose, dtype=torch.float32, device=self.device)[None]
        self.object.set_pose(Pose.create(placed))
        for arm, q, T in zip(self.agent.arms, WAITING + start.joint_offsets, T_WORLD_BASE, strict=True):
            qpos = np.concatenate([q, gripper_qpos(STROKE)])
            arm.reset(torch.tensor(qpos[None], dtype=torch.float32, device=self.device))
            arm.robot.set_pose(sapien.Pose(T))
        self._planner_reason = ""
        goal = torch.tensor(start.goal[None], dtype=torch.float32, device=self.device)
        noise = torch.tensor([int(self._generator(NOISE).integers(2**31))], device=self.device)
        self.memory.begin(placed, goal, noise)

    def reset(
        self, seed: int | list[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As ManiSkill's tasks, with its options alone."""
        obs, info = super().reset(seed=seed, options=dict(options or {}))
        if torch.isnan(self.memory.potential).any():
            self.memory.potential = outcome.potential(info, self.memory.goal)
        return obs, info

    def set_planner_reason(self, reason: str) -> None:
        """Say why a planner finds no grasps: ``info["planner_reason"]`` of the following steps of this episode."""
        self._planner_reason = reason

    # ------------------------------------------------------------------ state

    def get_state_dict(self) -> dict[str, Any]:
        """The state of the simulation, of the controllers, and of the task: `DualMemory`, step, joints before."""
        task = self.memory.to_state()
        task["elapsed_steps"] = self._elapsed_steps[:, None].float()
        task["qpos_before"] = torch.cat([arm._qpos_before for arm in self.agent.arms], dim=1)
        return {**super().get_state_dict(), "task": task}

    def set_state_dict(self, state: dict[str, Any], env_idx: torch.Tensor | None = None) -> None:
        """Go on from a state of `get_state_dict`, or of a recorded trajectory.

        What PhysX remembers of contacts is no part of it: what pads feel is known after the next step.

        Raises:
            TaskError: the state is of another object than that on the table.
        """
        task, controllers = (batched(state[key], self.device) for key in ("task", "controller"))
        own = self.memory.to_state()
        if not all(torch.equal(task[key].float(), own[key]) for key in ("kind", "instance")):
            raise TaskError("state: is of another object; reset with the seed of its episode first")
        super().set_state_dict(state, env_idx)
        self.agent.set_controller_state(controllers)
        self.memory.restore(task)
        self._elapsed_steps[:] = task["elapsed_steps"][:, 0].to(self._elapsed_steps.dtype)
        for arm, before in zip(self.agent.arms, task["qpos_before"].chunk(2, dim=1), strict=True):
            arm._qpos_before = before.clone()

    def set_state(self, state: torch.Tensor, env_idx: torch.Tensor | None = None) -> None:
        """The same from a flat state (1, D) of `get_state`."""
        self.set_state_dict(unflatten(state, self._init_raw_state)[0], env_idx)

    # ------------------------------------------------------------- evaluation

    def _height(self) -> torch.Tensor:
        return air_below(self.object.pose.raw_pose[:, None], self._hull)[:, 0]

    def _before_control_step(self) -> None:
        self.memory.note(self.object.pose.raw_pose, self._height())

    def evaluate(self) -> dict[str, Any]:
        forces = [pad_forces(arm, [self.object]) for arm in self.agent.arms]
        directions = [outward(arm.left_finger) for arm in self.agent.arms]
        pressed = [both_press(f[:, :, :-1], d)[:, 0] for f, d in zip(forces, directions, strict=True)]
        self._forces = torch.stack([squeeze(f, d) for f, d in zip(forces, directions, strict=True)], dim=1)
        surface = self.object.pose.to_transformation_matrix()
        surface = self._surface @ surface[:, :3, :3].mT + surface[:, None, :3, 3]
        hands = torch.stack([pads_centre(arm) for arm in self.agent.arms], dim=1)
        holds, pose, height = torch.stack(pressed, dim=1), self.object.pose.raw_pose, self._height()
        self.memory.loads = outcome.loads_of(self.model.mass, pose[:, :3], hands, holds, height)
        return {
            "elapsed_steps": self._elapsed_steps.clone(),
            **outcome.judge(self.memory, pose, height, holds, self.control_freq, self.layout.protective_stop),
            "loads": self.memory.loads.clone(),
            "mass": torch.tensor([self.model.mass], device=self.device),
            "distances": torch.cdist(hands, surface).min(dim=2).values,
            "object": Words.of([self.model.instance]),
            "planner_reason": Words.of([self._planner_reason]),
        }

    def _get_obs_extra(self, info: dict) -> dict[str, torch.Tensor]:
        arms = self.agent.arms
        observation = {
            "goal": self.memory.goal,
            "tcp_poses": torch.cat([arm.tcp_pose.raw_pose for arm in arms], dim=1),
            "openings": torch.stack([arm.gripper_opening for arm in arms], dim=1),
            "forces": self._forces,
        }
        return observation | ({"object_pose": self.object.pose.raw_pose} if self.obs_mode_struct.use_state else {})

    # ----------------------------------------------------------------- reward

    def compute_dense_reward(self, obs: Any, action: torch.Tensor, info: dict) -> torch.Tensor:
        before = self.memory.potential
        self.memory.potential = outcome.potential(info, self.memory.goal)
        return reward.reward(before, self.memory.potential, info)

    def compute_normalized_dense_reward(self, obs: Any, action: torch.Tensor, info: dict) -> torch.Tensor:
        return self.compute_dense_reward(obs, action, info) / 5


# For ManiSkill's own tools; Gymnasium knows the task from the package's __init__.
register("DualGrasp-v1", DualGraspEnv, max_episode_steps=MAX_EPISODE_STEPS)
