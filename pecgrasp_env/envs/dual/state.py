"""What happened in DualGrasp-v1: its memory of an episode, the judgement of the present moment, and the reward's terms.

Speeds come from positions, as in `pecgrasp_env.envs.task_state`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import torch
from mani_skill.utils.geometry.rotation_conversions import quaternion_to_matrix

from pecgrasp_env.envs.reward import reach
from pecgrasp_env.envs.task_state import LANDED_HEIGHT, LIFTED_HEIGHT, OFF_TABLE_HEIGHT, STILL_SPEED

MOST_TILT = 0.17453292519943295  # rad, 10 degrees
AT_GOAL = 0.03  # m
PAYLOAD_KG, HAND_KG = 5.0, 1.1  # that a UR5 carries at its flange; of that the 2F-140, its coupler and the camera
GRAVITY = 9.81  # m/s²
OVERLOAD_STEPS = 4  # control steps, 0.2 s: a knock stops no arm
_IN_THE_AIR = 0.005  # m, from which on the table bears nothing


@dataclass
class DualMemory:
    """What an episode remembers beyond the poses of things; N sub-environments.

    kind: (N,) long, index of the object's kind. instance, noise_seed: (N,) long below 2^31, of the object's shape, and
    of the sensor's noise and the sampling of clouds. start: (N, 7) pose at the start. goal: (N, 3) m, how far it is to
    be carried. before: (N, 3) m, position before the last control step. worst_tilt: (N,) rad. was_lifted, dropped: (N,)
    bool. loads: (N, 2) N, what the hands bore last. over_steps: (N,) long, for how many control steps a hand has borne
    too much; overloaded: (N,) bool. potential: (N,) of the reward after the last control step, NaN before the first.
    """

    kind: torch.Tensor
    instance: torch.Tensor
    noise_seed: torch.Tensor
    start: torch.Tensor
    goal: torch.Tensor
    before: torch.Tensor
    worst_tilt: torch.Tensor
    was_lifted: torch.Tensor
    dropped: torch.Tensor
    loads: torch.Tensor
    over_steps: torch.Tensor
    overloaded: torch.Tensor
    potential: torch.Tensor

    @classmethod
    def empty(cls, kind: torch.Tensor, instance: torch.Tensor) -> DualMemory:
        """For objects that have just been loaded; kind, instance: (N,) long."""
        n, device = len(kind), kind.device
        return cls(
            kind=kind,
            instance=instance,
            noise_seed=torch.zeros(n, dtype=torch.long, device=device),
            start=torch.zeros(n, 7, device=device),
            goal=torch.zeros(n, 3, device=device),
            before=torch.zeros(n, 3, device=device),
            worst_tilt=torch.zeros(n, device=device),
            was_lifted=torch.zeros(n, dtype=torch.bool, device=device),
            dropped=torch.zeros(n, dtype=torch.bool, device=device),
            loads=torch.zeros(n, 2, device=device),
            over_steps=torch.zeros(n, dtype=torch.long, device=device),
            overloaded=torch.zeros(n, dtype=torch.bool, device=device),
            potential=torch.full((n,), torch.nan, device=device),
        )

    def begin(self, start: torch.Tensor, goal: torch.Tensor, noise_seed: torch.Tensor) -> None:
        """A new episode in all sub-environments: where the object lies (N, 7), how far to carry it (N, 3), (N,)."""
        self.start, self.goal, self.noise_seed = start.clone(), goal.clone(), noise_seed.clone()
        self.before = start[:, :3].clone()
        self.worst_tilt = torch.zeros_like(self.worst_tilt)
        self.was_lifted = torch.zeros_like(self.was_lifted)
        self.dropped = torch.zeros_like(self.dropped)
        self.loads = torch.zeros_like(self.loads)
        self.over_steps = torch.zeros_like(self.over_steps)
        self.overloaded = torch.zeros_like(self.overloaded)
        self.potential = torch.full_like(self.potential, torch.nan)

    def note(self, pose: torch.Tensor, height: torch.Tensor) -> None:
        """Before a control step: where the object (N, 7) is, and how much air (N,) is under it."""
        over = (self.loads > (PAYLOAD_KG - HAND_KG) * GRAVITY).any(dim=1)
        self.over_steps = torch.where(over, self.over_steps + 1, torch.zeros_like(self.over_steps))
        self.overloaded |= self.over_steps >= OVERLOAD_STEPS
        self.worst_tilt = torch.maximum(self.worst_tilt, tilt_from(self.start, pose))
        self.was_lifted |= height > LIFTED_HEIGHT
        self.dropped |= self.was_lifted & (height < LANDED_HEIGHT)
        self.before = pose[:, :3].clone()

    def to_state(self) -> dict[str, torch.Tensor]:
        """As float32 tensors (N, D), which ManiSkill stores with a state; `restore` takes them back without loss."""
        return {each.name: _as_floats(getattr(self, each.name)) for each in fields(self)}

    def restore(self, state: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `to_state`."""
        for each in fields(self):
            now, then = getattr(self, each.name), state[each.name]
            if now.dtype == torch.long:
                then = (then[:, 0].long() << 16) + then[:, 1].long()
            setattr(self, each.name, then.reshape(now.shape).to(now.dtype, copy=True))


def _as_floats(values: torch.Tensor) -> torch.Tensor:
    # A float32 holds integers up to 2^24 only.
    halves = torch.stack([values >> 16, values & 0xFFFF], dim=1) if values.dtype == torch.long else values
    return halves.reshape(len(values), -1).to(torch.float32, copy=True)


def tilt_from(start: torch.Tensor, pose: torch.Tensor) -> torch.Tensor:
    """Angle (N,), rad, by which the direction that was up at the start (N, 7) has left the vertical in a pose (N, 7).

    From the cross product: an arc cosine has no digits left near zero.
    """
    turned = quaternion_to_matrix(pose[:, 3:]) @ quaternion_to_matrix(start[:, 3:]).mT
    up = turned[:, :, 2]
    return torch.atan2(torch.linalg.norm(up[:, :2], dim=1), up[:, 2])


def loads_of(
    mass: float, centre: torch.Tensor, hands: torch.Tensor, holds: torch.Tensor, height: torch.Tensor
) -> torch.Tensor:
    """What of the weight each hand bears, (N, 2) N, by the lever rule: as two hands do that lift and do not turn.

    mass: kg. centre: (N, 3) m, of mass. hands: (N, 2, 3) m, where they hold it. holds: (N, 2) bool. height: (N,) m.
    Contacts in PhysX tell what presses, not what rubs, and two stiff hands might share a weight in any way.
    """
    line = hands[:, 1, :2] - hands[:, 0, :2]
    along = ((centre[:, :2] - hands[:, 0, :2]) * line).sum(dim=1) / (line * line).sum(dim=1).clamp(min=1e-9)
    shares = torch.where(holds.all(dim=1)[:, None], torch.stack([1 - along, along], dim=1), holds.float())
    return mass * GRAVITY * shares * (height > _IN_THE_AIR)[:, None]


def judge(
    memory: DualMemory,
    pose: torch.Tensor,
    height: torch.Tensor,
    holds: torch.Tensor,
    control_freq: float,
    protective_stop: bool,
) -> dict[str, torch.Tensor]:
    """What the present moment is, one value a sub-environment; the meaning of each key is in the task's card.

    pose: (N, 7). height: (N,) m. holds: (N, 2) bool. control_freq: Hz. protective_stop: an overloaded arm ends it.
    """
    tilt = tilt_from(memory.start, pose)
    worst = torch.maximum(memory.worst_tilt, tilt)
    moved = pose[:, :3] - memory.start[:, :3]
    speed = torch.linalg.norm(pose[:, :3] - memory.before, dim=1) * control_freq
    goal_distance = torch.linalg.norm(moved - memory.goal, dim=1)
    tilted, off_table = worst >= MOST_TILT, height < OFF_TABLE_HEIGHT
    fail = tilted | off_table | (memory.overloaded & protective_stop)
    carried = ~fail & (goal_distance < AT_GOAL) & (speed < STILL_SPEED) & holds.any(dim=1)
    return {
        "success": carried & holds.all(dim=1),
        "fail": fail,
        "carried_level": carried,
        "tilted": tilted,
        "off_table": off_table,
        "overloaded": memory.overloaded.clone(),
        "dropped": memory.dropped | (memory.was_lifted & (height < LANDED_HEIGHT)),
        "holds": holds,
        "tilt": tilt,
        "worst_tilt": worst,
        "height": height,
        "goal_distance": goal_distance,
        "speed": speed,
        "centre_of_mass": pose[:, :3].clone(),
    }


def potential(info: Mapping[str, torch.Tensor], goal: torch.Tensor) -> torch.Tensor:
    """How far the task has got, (N,), 0 … 4. goal: (N, 3) m, as in the memory."""
    both = info["holds"].all(dim=1)
    far = torch.linalg.norm(goal, dim=1)
    on_the_way = (1 - info["goal_distance"] / far).clamp(0, 1) * both
    still = (1 - torch.tanh(10 * info["speed"])) * (both & (info["goal_distance"] < AT_GOAL))
    return reach(info["distances"]).mean(dim=1) + info["holds"].float().mean(dim=1) + on_the_way + still
