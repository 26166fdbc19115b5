"""SelectiveGrasp-v1: pick the object that was asked for out of several, with a UR5 and a Robotiq 2F-140."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils import sapien_utils
from mani_skill.utils.registration import register
from mani_skill.utils.structs.pose import Pose
from mani_skill.utils.structs.types import DefaultMaterialsConfig, SceneConfig, SimConfig

from pecgrasp_env.envs import reward, validation
from pecgrasp_env.envs import task_state as outcome
from pecgrasp_env.envs.contacts import pad_forces, pads_centre, squeeze
from pecgrasp_env.envs.episode_start import draw_start, fixed_meshes, visible_share
from pecgrasp_env.envs.registration import MAX_EPISODE_STEPS
from pecgrasp_env.envs.reset_options import read_options
from pecgrasp_env.envs.restorable_env import RestorableEnv
from pecgrasp_env.envs.validation import TaskError, take_options
from pecgrasp_env.envs.words import Words
from pecgrasp_env.envs.wrist_camera_env import NOISE
from pecgrasp_env.robot.agent import UR5Robotiq2F140
from pecgrasp_env.robot.answer import AnsweringUR5Robotiq2F140
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA, forward_kinematics
from pecgrasp_env.robot.pad_contact import both_press, held_between, outward
from pecgrasp_env.scene import table as workbench
from pecgrasp_env.scene.actors import Recipe, SceneObjects, Wish
from pecgrasp_env.scene.clutter import BIN
from pecgrasp_env.scene.draw_objects import STRANGER
from pecgrasp_env.scene.settling import CONTACT_OFFSET_M
from pecgrasp_env.scene.visibility import lying_on, placed_mesh

_FAR_APART = 0.03  # m, clearance from which on PhysX's persistent contact manifolds do no harm, see `fall`

# Streams of random numbers of one episode: which objects and how they lie are drawn apart.
_CHOICE, _LAYOUT, _NOISE, _PHYSICS, _LIGHT, _ABSENCE = 0, 1, NOISE, 3, 4, 5


class SelectiveGraspEnv(RestorableEnv):
    """
    ## Description
    Several objects lie on a table, or in a bin on it. One class is asked for. The arm has to take hold of an object of
    that class and to lift it; to lift another one, or to push anything off the table, is a failure. Among the objects
    may be strangers, things of none of the classes, which are never the right one; and with `absent` the asked-for
    class may not be there at all, which is to be said.

    The world frame is the robot's base frame: z up, tabletop at z = 0, the objects in front of the robot within
    0.33 m < x < 0.67 m, abs(y) < 0.25 m. Lengths in metres, angles in radians, quaternions w, x, y, z. Control at
    20 Hz, physics at 100 Hz.

    ## Action Space
    `Box(8,)` float32, by `control_mode`; all limits are finite:
    | mode | 0–5 | 6 | 7 |
    |---|---|---|---|
    | `pd_joint_pos` | joint targets, rad | gripper opening, 0 … 0.14 m | force limit, 10 … 125 N |
    | `pd_joint_delta_pos` | joint steps, ±1 is ±0.1 rad | opening, −1 … 1 over its range | force limit, likewise |
    | `pd_ee_pose` | tool position, m, and XYZ Euler angles, rad, base frame | opening, m | force limit, N |
    | `pd_ee_delta_pose` | tool step, ±1 is ±0.1 m and ±0.1 rad | opening, −1 … 1 | force limit, −1 … 1 |

    With `absent` it is `Box(9,)` in all of them: number 8, −1 … 1, says above 0.5 that no object of the asked-for class
    is there, and that ends the episode.

    ## Observation Space
    In the mode `state_dict` (`state` is the same, flattened), first axis the sub-environments; all limits are finite:
    | key | shape | unit, frame | meaning |
    |---|---|---|---|
    | agent/qpos | (10,) | rad | six arm joints from shoulder pan on, two cranks, two fingers of the gripper |
    | agent/qvel | (10,) | rad/s | their mean rates over the last step |
    | agent/controller/gripper/target_opening | (1,) | m | opening that the gripper is on its way to |
    | agent/controller/gripper/force_limit | (1,) | N | force limit that it was given last |
    | extra/target | (n_classes,) | | the asked-for class, one-hot in the order of `classes`; as text in `info` |
    | extra/tcp_pose | (7,) | m, wxyz; world | the fixed tool point, at the pads' centre of the closed gripper |
    | extra/opening | (1,) | m | measured gripper opening |
    | extra/force | (1,) | N | measured grip force, mean of both pads along the closing axis, 0 … 250 |
    | extra/target_pose | (7,) | m, wxyz; world | in state modes only: of the asked-for (nearer) object; 0 if absent |
    | extra/object_poses | (7 · K,) | m, wxyz; world | in state modes only: all K objects, strangers too, in no order |

    `cloud` replaces the last two by what the wrist camera sees of the objects and the hand:
    | key | shape | unit, frame | meaning |
    |---|---|---|---|
    | cloud | (cloud_points, 3) | m; base | points more than 5 mm above the table, sampled by seed, step and pixel |

    ManiSkill's visual modes give all that the wrist camera, `wrist_camera`, sees: `pointcloud`, `rgbd`, or one or more
    of `rgb`, `depth`, `segmentation`, `position`, `normal`, `albedo` joined by +, to which `state` or `state_dict` may
    be added. Depth is float32 in metres along the optical axis and 0 where there is none; point clouds are in the world
    frame, their fourth value is 0 where there is no point; normals are in the camera's frame, OpenGL axes.
    `sensor_data` gives the renderer's own textures, before the sensor; `none` nothing.

    ## Rewards
    `sparse`: 1 on success, −1 on failure, else 0.

    `dense`, per step: what the step has added to a potential, so that what is gained on the way to a state is lost on
    the way back and only progress pays. An episode's return is the potential at its end less that at its start (under
    1), and 5 or −1 for how it ended: idling, pushing and shaking earn nothing, however long.
    | term of the potential | range |
    |---|---|
    | reach: 1 − tanh(5 · distance from the pads' centre to the nearest asked-for object in m) | 0 … 1 |
    | grasp: an asked-for object is held | 0, 1 |
    | lift: air under it / 0.15 m, while held | 0 … 1 |
    | still: 1 − tanh(10 · its speed in m/s), while held 0.15 m above the table | 0 … 1 |
    | wrong: another object is held, and not one that `clear` allows to take away | −1, 0 |

    | at the end | |
    |---|---|
    | success, be it lifted or rightly said to be absent (instead of the step's progress) | 5 |
    | failure, also wrongly said to be absent (besides it) | −1 |

    `normalized_dense` is a fifth of it.

    ## Starting State
    `n_objects` instances are drawn, dropped in random orientations, and laid out where they came to rest, as densely
    as `clutter` says: apart, 5 … 20 mm from the nearest other ("close"), leaning against others ("touching"), dropped
    onto each other ("piled"), or dropped into a bin ("bin"), which stands at (0.5, 0), is 0.25 m wide along x, 0.35 m
    along y and 0.12 m high inside, its bottom and walls 6 mm thick. Their classes all differ while there are enough of
    them; one is asked for. Where there are more objects than classes, others than the asked-for one come twice or more.
    With `same_class_twins` the asked-for class is there twice, and either of the two is right. With `n_strangers` so
    many strangers lie among them, different ones while there are enough. More than 5 objects, and strangers, are spread
    over 0.30 m < x < 0.67 m, abs(y) < 0.33 m. The arm hangs over the table in its home posture, the camera looking at
    the objects, ± `joint_noise`.

    With `absent` one class always stays away, so that what lies there tells nothing: the objects are drawn from the
    other classes, and with the probability `absent` one that is not there is asked for.

    Everything is drawn by generators of the sub-environment, so that an episode depends on its seed and neither on the
    number of environments nor on what came before; where objects are drawn once only (`reconfiguration_freq`), they
    are those of the seed of `reset(seed=…, options={"reconfigure": True})`. Randomised: instances, resting poses,
    places, the asked-for class, the arm's posture, the sensor's noise; with the arguments below friction, mass, light.

    `reset(seed=…, options={…})` asks for what is drawn otherwise; seed and options fix the episode:
    | option | meaning |
    |---|---|
    | target | the class that is asked for; new objects are drawn so that it is there, those that stay must have it |
    | objects | what lies there, in this order: `n_objects` names of classes, of instances, or class/instance |
    | strangers | which strangers, by their names: `n_strangers` of them |
    | absent | whether the asked-for class is away, True or False; needs an environment made with `absent` |
    | reconfigure, env_idx, reset_to_env_states | ManiSkill's |

    With `objects` or `strangers` the scene is built anew; of the objects one is asked for, or with `absent` one that is
    not among them. With several sub-environments each option may be a list with one entry for each of those that are
    reset. Others raise `TaskError`.

    ## Episode End
    Terminated on success: an object of the asked-for class is held, at least 0.15 m of air under all of it, and moves
    slower than 0.02 m/s. Terminated on failure: `wrong_object` or `off_table`. With `absent` also terminated as soon as
    the class is said not to be there: a success where it is not, a failure where it is. Truncated after 400 steps.

    With `clear` an object may be taken away once the pads hold it while it lies on one of the asked-for class and has
    risen by no more than 0.05 m since the start. They hold it where both press on it, or one does and the other on
    something else, none of the two of the asked-for class. It lies on another where, seen from straight above, 1 cm² of
    it or more is above that one, or above something that so lies on that one. From then on it is no `wrong_object`,
    however high it is lifted, and no `wrong_held`. That it leaves the table still is a failure, and so is lifting any
    other object: one that only hides the asked-for one from the camera, or that comes up with one that was taken.
    Nothing is earned by taking away.

    `info` says what happened, one value a sub-environment:
    | key | meaning |
    |---|---|
    | success, fail | as above |
    | wrong_object | an object of another class, that may not be taken away, has 0.05 m of air more than at the start |
    | off_table | any object has left the table |
    | dropped | an asked-for object had been lifted and is down again: no failure, it may be picked up again |
    | disturbance_m | how far the other object that was moved most is from where it lay at the start, m |
    | target_held, wrong_held | both pads press on an object of the asked-for class, on a wrong one |
    | visible_share | share of the asked-for object in the wrist camera that nothing hides at the start, exact |
    | target_distance | from the pads' centre to the nearest object of the asked-for class, m; inf if absent |
    | grip_force | as `extra/force`, N |
    | target_air, target_speed | air under the asked-for object, m, and its speed, m/s; of twins the one that is up |
    | target | the asked-for class as text, an array of words |
    | stranger_lifted | with `n_strangers`: the wrong object is one of these |
    | absent, said_absent | with `absent`: no object of the asked-for class is there; it was said |
    | planner_reason | what was last given to `set_planner_reason` in this episode, or "" |

    ## Arguments
    | name | default | meaning |
    |---|---|---|
    | `n_objects` | 3 | 1 … 8, piled or in a bin … 15, of the classes |
    | `n_strangers` | 0 | further objects that are of none of them; together as many at most as above |
    | `strangers` | None | None: composed by seed; a folder of meshes; or an opened source |
    | `absent` | False | the asked-for class is not there, to be said: True, or the probability of it |
    | `classes` | None | what may lie there, in the one-hot's order; None: the LARS five, or all of a folder or source |
    | `objects` | None | None: the catalogue; a mesh folder's path; arguments of `open_objects`; or an opened source |
    | `clutter` | "apart" | "apart", "close", "touching", "piled" or "bin", see Starting State |
    | `clear` | False | what lies on the asked-for object may be taken away, see Episode End |
    | `same_class_twins` | False | the asked-for class lies there twice, either is right |
    | `clearance` | 0.03 | least distance between two outlines at the start where they lie apart, m |
    | `joint_noise` | 0.02 | greatest deviation of each arm joint from the home posture at the start, rad |
    | `friction` | None | limits between which each object's friction is drawn; None: 0.6 |
    | `mass_scale` | None | limits of what each object's mass is multiplied by; not below 20 g |
    | `light` | "fixed" | "random": lamp's direction and strength of the light, for colour images |
    | `sensor` | "ideal" | "ideal": noise-free depth beyond the minimum distance; "d435": with the camera's faults |
    | `resolution` | "424x240" | depth mode of the D435, see `pecgrasp_env.sensor.D435` |
    | `cloud_points` | 1024 | points of the observation mode `cloud` |
    | `reconfiguration_freq` | 1 with one sub-environment, else 0 | resets between draws of new objects; 0: draw once |

    and those of `mani_skill.envs.sapien_env.BaseEnv`, among them `enable_shadow` for images, `sim_config` and
    `sensor_configs`. The latter's `width`, `height`, `fov`, `intrinsic`, `near`, `far`, `pose` and `shader_pack` change
    the wrist camera, for all sensors or under `wrist_camera`: with another size the horizontal field of view of
    `resolution` stays, pixels are square and the principal point is central; `fov` (vertical, rad) or `intrinsic`
    (3 × 3) take the place of the D435's focal length. Arguments that make no sense raise `TaskError` or `SensorError`,
    unknown ones `TypeError`; objects that do not fit on the table, `PlacementError` at the reset. A state
    (`get_state_dict`, `get_state`) holds the task's memory, too; it fits the objects of its own episode.
    `num_envs` > 1 needs a GPU (`physx_cuda`). Never run: no GPU was at hand. On a CPU `SelectiveGraspSingle-v1` with
    `gymnasium.make_vec` runs many in as many processes.

    ## Version History
    - v1: first version.
    """

    SUPPORTED_ROBOTS = (UR5Robotiq2F140.uid, AnsweringUR5Robotiq2F140)
    SUPPORTED_REWARD_MODES = ("normalized_dense", "dense", "sparse", "none")

    def __init__(
        self,
        *args: Any,
        robot_uids: Any = UR5Robotiq2F140.uid,
        obs_mode: str | None = None,
        sensor_configs: Mapping[str, Any] | None = None,
        shader_dir: str | None = None,
        num_envs: int = 1,
        sim_backend: str = "auto",
        reconfiguration_freq: int | None = None,
        **kwargs: Any,
    ) -> None:
        """kwargs: fields of `SceneOptions`, `SensingOptions` and `Randomisation` by name, and ManiSkill's."""
        self.layout, self.sensing, self.randomisation = take_options(kwargs)
        validation.check_base_arguments(BaseEnv, kwargs)
        if kwargs.get("render_backend", "gpu") is None:
            kwargs["render_backend"] = "none"
        validation.check_obs_mode(obs_mode, kwargs.get("render_backend", "gpu"))
        validation.check_simulator(num_envs, sim_backend, kwargs.get("parallel_in_single_scene", False))
        robot: Any = validation.check_robot(robot_uids, UR5Robotiq2F140)
        if self.layout.answers:
            robot = AnsweringUR5Robotiq2F140
        self.source, self.classes = self.layout.open()
        self.recipe = Recipe(
            self.source,
            self.classes,
            self.layout.n_objects,
            self.layout.same_class_twins,
            self.randomisation.friction,
            self.randomisation.mass_scale,
            self.layout.n_strangers,
            self.layout.open_strangers(self.classes),
            float(self.layout.absent) if self.layout.answers else None,
        )
        self._fixed = fixed_meshes(self.layout.clutter)
        self._wishes = [Wish()] * num_envs
        if reconfiguration_freq is None:
            reconfiguration_freq = 1 if num_envs == 1 else 0
        if reconfiguration_freq < 0:
            raise TaskError(f"reconfiguration_freq={reconfiguration_freq}: must be 0 or more resets")
        cameras = self._camera_arguments(obs_mode, shader_dir, sensor_configs)
        validation.claim_process()
        shader = {} if shader_dir is None else {"shader_pack": shader_dir}
        for name in ("human_render_camera_configs", "viewer_camera_configs"):
            kwargs[name] = shader | dict(kwargs.get(name) or {})
        super().__init__(
            *args,
            robot_uids=robot,
            obs_mode="depth" if self._only_cloud else obs_mode,
            sensor_configs=cameras,
            num_envs=num_envs,
            sim_backend=sim_backend,
            reconfiguration_freq=reconfiguration_freq,
            **kwargs,
        )

    # ------------------------------------------------------------------ scene

    @property
    def _default_sim_config(self) -> SimConfig:
        materials = DefaultMaterialsConfig(static_friction=0.6, dynamic_friction=0.6)
        near = self.layout.clutter != "apart" or self.layout.clearance < _FAR_APART
        contacts = SceneConfig(contact_offset=CONTACT_OFFSET_M, enable_pcm=not near)
        return SimConfig(default_materials_config=materials, scene_config=contacts)

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:
        pose = sapien_utils.look_at([1.25, 0.80, 0.80], [0.36, 0.0, 0.22])
        return CameraConfig("render_camera", pose, 640, 480, 0.82, 0.05, 60)

    def _load_agent(self, options: dict) -> None:
        with warnings.catch_warnings():
            # ManiSkill's passive controller casts a box without numbers.
            warnings.filterwarnings("ignore", message=".*precision lowered by casting")
            super()._load_agent(options, sapien.Pose())

    def _load_lighting(self, options: dict) -> None:
        generators = (
            [self._generator(i, _LIGHT) for i in range(self.num_envs)] if self.randomisation.light == "random" else None
        )
        workbench.light(self.scene, shadow=self.enable_shadow, generators=generators)

    def _load_scene(self, options: dict) -> None:
        workbench.build_table(self.scene)
        workbench.build_floor(self.scene)
        if self.layout.clutter == "bin":
            BIN.add_to(self.scene.create_actor_builder()).build_static(name="bin")
        # An asked-for object takes no fixed slot: its number in a segmentation image must not give it away.
        draws = [self._generator(i, _CHOICE) for i in range(self.num_envs)]
        physics = [self._generator(i, _PHYSICS) for i in range(self.num_envs)]
        self.table = SceneObjects(self, self.recipe, draws, physics, self._wishes)
        self.models, self.objects = self.table.models, self.table.actors
        self.memory = outcome.Memory.empty(self.table.instances, self.layout.answers)
        self.target_names = [""] * self.num_envs
        self._planner_reasons = [""] * self.num_envs

    # ---------------------------------------------------------------- episode

    def _generator(self, env_index: int, stream: int) -> np.random.Generator:
        """A generator of one sub-environment's own, one for each purpose."""
        return np.random.default_rng([stream, self._batched_episode_rng.rngs[env_index].randint(2**31)])

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict) -> None:
        indices = env_idx.tolist()
        self._set_scene_config()  # the private scene of the fall takes the physics engine's current settings
        poses = np.zeros((len(indices), self.recipe.n_slots, 7))
        asked, noise = np.zeros(len(indices), np.int64), np.zeros(len(indices), np.int64)
        visible = np.zeros(len(indices), np.float32)
        home = np.asarray(self.agent.keyframes["home"].qpos, dtype=np.float32)
        qpos = np.tile(home, (len(indices), 1))
        for row, i in enumerate(indices):
            rng = self._generator(i, _LAYOUT)
            noise[row] = self._generator(i, _NOISE).integers(2**31)
            absence = self._generator(i, _ABSENCE) if self.layout.answers else None
            start = draw_start(self.table, i, self.layout, self._wishes[i], rng, absence)
            asked[row], poses[row] = start.asked, start.poses
            qpos[row, :6] += start.joint_offsets
            visible[row] = visible_share(
                self.models[i],
                start.poses,
                [k == start.asked for k in self.table.slot_class[i].tolist()],
                self._fixed,
                forward_kinematics(qpos[row, :6]) @ T_TOOL0_CAMERA @ self._T_link_camera,
                self._intrinsics,
            )
            self.target_names[i] = self.classes[asked[row]]
            self._planner_reasons[i] = ""
        placed = torch.tensor(poses, dtype=torch.float32, device=self.device)
        for slot, actor in enumerate(self.objects):
            actor.set_pose(Pose.create(placed[:, slot]))
        self.agent.reset(torch.tensor(qpos, device=self.device))
        self.agent.robot.set_pose(sapien.Pose())
        asked_for, noise_seeds, shares = (
            torch.as_tensor(numbers, device=self.device) for numbers in (asked, noise, visible)
        )
        air = outcome.air_below(placed, self.table.hull_vertices[env_idx])
        self.memory.begin(env_idx, asked_for, placed[..., :3], air, noise_seeds, shares)

    @property
    def target_class(self) -> torch.Tensor:
        """Index of the asked-for class in ``classes``, (num_envs,)."""
        return self.memory.asked

    @property
    def is_target(self) -> torch.Tensor:
        """Which objects are of the asked-for class, (num_envs, K) bool."""
        return self.table.slot_class == self.memory.asked[:, None]

    @property
    def is_stranger(self) -> torch.Tensor:
        """Which objects are strangers, (num_envs, K) bool."""
        return self.table.slot_class == STRANGER

    def set_planner_reason(self, reason: str, env_index: int = 0) -> None:
        """Say why a planner finds no grasp, or what else it has to say: ``info["planner_reason"]`` of the following
        steps of this episode. The task does not look at it; records and reports do.
        """
        self._planner_reasons[env_index] = reason

    # ------------------------------------------------------------- evaluation

    def reset(
        self, seed: int | list[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As ManiSkill's tasks; the card above says which ``options`` there are. Raises TaskError for others."""
        theirs, self._wishes = read_options(options, self.recipe, self.num_envs)
        draws_anew = self._reconfig_counter == 0 and self.reconfiguration_freq != 0
        if not (theirs.get("reconfigure") or draws_anew):
            self._check_targets()
        obs, info = super().reset(seed=seed, options=theirs)
        # Only now does a GPU know where the hand is.
        begun = torch.isnan(self.memory.potential)
        self.memory.potential = torch.where(begun, reward.reach(info["target_distance"]), self.memory.potential)
        return obs, info

    def _check_targets(self) -> None:
        """Of objects that stay where they are one cannot ask for what is not there, nor for its absence if it is."""
        for i, wish in enumerate(self._wishes):
            if wish.target is None:
                continue
            there = [model.class_name for model in self.models[i]]
            is_there = self.classes[wish.target] in there
            if wish.absent is is_there or not (is_there or self.layout.answers):
                raise TaskError(
                    f"options={{'target': {self.classes[wish.target]!r}}}: on the table are {', '.join(there)}, which "
                    "stay there; new ones come with options={'reconfigure': True, …} or {'objects': […], …}"
                )

    def _before_control_step(self) -> None:
        poses = self.table.poses()
        said = self.agent.said_absent if isinstance(self.agent, AnsweringUR5Robotiq2F140) else None
        air = outcome.air_below(poses, self.table.hull_vertices)
        self.memory.note(poses[..., :3], air, self.is_target, said)

    def evaluate(self) -> dict[str, Any]:
        poses = self.table.poses()
        positions = poses[..., :3]
        air = outcome.air_below(poses, self.table.hull_vertices)
        directions = outward(self.agent.left_finger)
        forces = pad_forces(self.agent, self.objects)
        held = both_press(forces[:, :, :-1], directions)
        if self.layout.clear:
            low = air - self.memory.air_at_start <= outcome.WRONG_LIFT_HEIGHT
            between = held_between(forces[:, :, :-1], directions)
            alone = between & ~(between & self.is_target).any(dim=1, keepdim=True)
            self._let_take((held | alone) & low, poses)
        distances = torch.linalg.norm(positions - pads_centre(self.agent)[:, None], dim=2)
        nearest = distances.masked_fill(~self.is_target, torch.inf).min(dim=1)
        self._nearest = nearest.indices
        return {
            "elapsed_steps": self._elapsed_steps.clone(),
            **outcome.judge(
                self.memory,
                self.is_target,
                positions,
                air,
                held,
                self.control_freq,
                self.is_stranger if self.layout.n_strangers else None,
            ),
            "target_distance": nearest.values,
            "grip_force": squeeze(forces, directions),
            "target": Words.of(self.target_names),
            "planner_reason": Words.of(self._planner_reasons),
        }

    def _let_take(self, taken: torch.Tensor, poses: torch.Tensor) -> None:
        """What is taken hold of, (N, K) bool, while it lies on the asked-for object may be taken away."""
        for i in torch.nonzero((taken & ~self.is_target & ~self.memory.may_take).any(dim=1))[:, 0].tolist():
            meshes = [placed_mesh(*each) for each in zip(self.models[i], poses[i].cpu().numpy(), strict=True)]
            upon = torch.as_tensor(lying_on(meshes), device=self.device)
            self.memory.may_take[i] |= taken[i] & upon[:, self.is_target[i]].any(dim=1)

    # ------------------------------------------------------------ observation

    def _get_obs_extra(self, info: dict) -> dict[str, torch.Tensor]:
        observation = {
            "target": torch.nn.functional.one_hot(self.target_class, len(self.classes)).float(),
            "tcp_pose": self.agent.tcp_pose.raw_pose,
            "opening": self.agent.gripper_opening[:, None],
            "force": info["grip_force"][:, None],
        }
        if self.obs_mode_struct.use_state:
            poses = self.table.poses()
            target_pose = poses[torch.arange(self.num_envs, device=self.device), self._nearest]
            target_pose = target_pose.masked_fill(~self.is_target.any(dim=1, keepdim=True), 0.0)
            observation |= {"target_pose": target_pose, "object_poses": poses.flatten(1)}
        return observation

    # ----------------------------------------------------------------- reward

    def compute_dense_reward(self, obs: Any, action: torch.Tensor, info: dict) -> torch.Tensor:
        before = self.memory.potential
        self.memory.potential = reward.potential(info)
        return reward.reward(before, self.memory.potential, info)

    def compute_normalized_dense_reward(self, obs: Any, action: torch.Tensor, info: dict) -> torch.Tensor:
        return self.compute_dense_reward(obs, action, info) / 5


# For ManiSkill's own tools; Gymnasium knows the task from the package's __init__.
register("SelectiveGrasp-v1", SelectiveGraspEnv, max_episode_steps=MAX_EPISODE_STEPS)
