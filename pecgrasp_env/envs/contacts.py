"""What the pads press on, and how hard.

On the CPU, ManiSkill walks through all contacts of the scene once for every pair of bodies that it is asked about; here
they are walked through once a step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from mani_skill.utils.structs.actor import Actor

from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.agent import UR5Robotiq2F140


def pad_forces(agent: UR5Robotiq2F140, objects: Sequence[Actor]) -> torch.Tensor:
    """Force on the pads by each object, and by everything there is: (num_envs, 2, n_objects + 1, 3) N, world frame.

    Second axis: left and right finger. Third: the objects in their order, then the sum over all bodies.
    """
    fingers = (agent.left_finger, agent.right_finger)
    if not agent.scene.gpu_sim_enabled:
        return torch.from_numpy(_walk(agent, fingers, objects))[None]
    by_finger = []
    for finger in fingers:
        forces = [agent.scene.get_pairwise_contact_forces(finger, actor) for actor in objects]
        by_finger.append(torch.stack([*forces, finger.get_net_contact_forces()], dim=1))
    return torch.stack(by_finger, dim=1)


def _walk(agent: UR5Robotiq2F140, fingers: Sequence, objects: Sequence[Actor]) -> np.ndarray:
    """The same for the one sub-environment of a CPU simulation, (2, n_objects + 1, 3)."""
    side = {finger._bodies[0].entity.per_scene_id: k for k, finger in enumerate(fingers)}
    number = {actor._bodies[0].entity.per_scene_id: k for k, actor in enumerate(objects)}
    impulses = np.zeros((2, len(objects) + 1, 3), np.float32)
    for contact in agent.scene.px.get_contacts():
        first, second = (body.entity.per_scene_id for body in contact.bodies)
        for own, other, sign in ((first, second, 1), (second, first, -1)):
            if own in side:
                # An impulse acts on the first of the two bodies.
                impulse = sign * np.sum([point.impulse for point in contact.points], axis=0)
                impulses[side[own], -1] += impulse
                if other in number:
                    impulses[side[own], number[other]] += impulse
    return impulses / agent.scene.px.timestep


def pads_centre(agent: UR5Robotiq2F140) -> torch.Tensor:
    """Midway between the pads' centres, (num_envs, 3) m, world frame; the fingers are parallel."""
    left, right = agent.left_finger.pose, agent.right_finger.pose
    approach = left.to_transformation_matrix()[..., :3, 2]
    return (left.p + right.p) / 2 + linkage.PAD_CENTRE_Z * approach


def squeeze(forces: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
    """Grip force (num_envs,) N: the mean of both pads' force along the closing axis, 0 … linkage.FORCE_RANGE_N.

    forces: of `pad_forces`. directions: of `pecgrasp_env.robot.pad_contact.outward`.
    """
    return (forces[:, :, -1] * directions).sum(dim=2).mean(dim=1).clamp(0.0, linkage.FORCE_RANGE_N)
