"""What happened: the task's own memory of an episode, and the judgement of the present moment.

PhysX reports velocities of bodies that stand still under a squeeze, so all speeds here come from positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from mani_skill.utils.geometry.rotation_conversions import quaternion_to_matrix

LIFT_HEIGHT = 0.15  # m of air under an asked-for object: success
# m of air more than at the start, where an object may lie on others:
WRONG_LIFT_HEIGHT = 0.05  # under any other object: failure
LIFTED_HEIGHT = 0.05  # under an asked-for object from which on it can be dropped
LANDED_HEIGHT = 0.02
OFF_TABLE_HEIGHT = -0.02  # m, height of a lowest point below which an object has left the table
STILL_SPEED = 0.02  # m/s


@dataclass
class Memory:
    """What an episode remembers beyond the poses of things; N sub-environments, K objects.

    asked: (N,) long, index of the asked-for class. instances: (N, K) long, which instances lie on the table.
    was_lifted: (N, K) bool, an asked-for object was more than LIFTED_HEIGHT above the table. dropped: (N,) bool.
    start, before: (N, K, 3) m, positions at the start of the episode and before the last control step.
    air_at_start: (N, K) m, 0 or more.
    potential: (N,) of the reward after the last control step, NaN where none was taken.
    noise_seed: (N,) long below 2^31, of the sensor's noise and the sampling of clouds.
    visible_share: (N,) at the start. may_take: (N, K) bool, objects that it is no failure to take away.
    said_absent: (N,) bool, it was said that the asked-for class is not there; None where that cannot be said.
    """

    asked: torch.Tensor
    instances: torch.Tensor
    was_lifted: torch.Tensor
    dropped: torch.Tensor
    start: torch.Tensor
    before: torch.Tensor
    air_at_start: torch.Tensor
    potential: torch.Tensor
    noise_seed: torch.Tensor
    visible_share: torch.Tensor
    may_take: torch.Tensor
    said_absent: torch.Tensor | None = None

    @classmethod
    def empty(cls, instances: torch.Tensor, answers: bool = False) -> Memory:
        """For objects that have just been loaded; instances: (N, K) long. answers: absence can be said."""
        (n, k), device = instances.shape, instances.device
        return cls(
            asked=torch.zeros(n, dtype=torch.long, device=device),
            instances=instances,
            was_lifted=torch.zeros(n, k, dtype=torch.bool, device=device),
            dropped=torch.zeros(n, dtype=torch.bool, device=device),
            start=torch.zeros(n, k, 3, device=device),
            before=torch.zeros(n, k, 3, device=device),
            air_at_start=torch.zeros(n, k, device=device),
            potential=torch.full((n,), torch.nan, device=device),
            noise_seed=torch.zeros(n, dtype=torch.long, device=device),
            visible_share=torch.zeros(n, device=device),
            may_take=torch.zeros(n, k, dtype=torch.bool, device=device),
            said_absent=torch.zeros(n, dtype=torch.bool, device=device) if answers else None,
        )

    def begin(
        self,
        env_idx: torch.Tensor,
        asked: torch.Tensor,
        start: torch.Tensor,
        air: torch.Tensor,
        noise_seed: torch.Tensor,
        visible_share: torch.Tensor,
    ) -> None:
        """A new episode in the sub-environments ``env_idx`` (M,): class (M,), positions (M, K, 3) and air (M, K) under
        the objects, seeds (M,), and how much of the asked-for object is seen (M,).
        """
        self.asked[env_idx] = asked
        self.noise_seed[env_idx] = noise_seed
        self.visible_share[env_idx] = visible_share
        self.may_take[env_idx] = False
        self.start[env_idx] = self.before[env_idx] = start
        self.air_at_start[env_idx] = air.clamp(min=0.0)
        self.was_lifted[env_idx] = False
        self.dropped[env_idx] = False
        self.potential[env_idx] = torch.nan
        if self.said_absent is not None:
            self.said_absent[env_idx] = False

    def note(
        self, positions: torch.Tensor, air: torch.Tensor, is_asked: torch.Tensor, said: torch.Tensor | None = None
    ) -> None:
        """Before a control step: where the objects (N, K, 3) are, how much air (N, K) is under them, and whether the
        action says (N,) that the asked-for class is not there.
        """
        if said is not None and self.said_absent is not None:
            self.said_absent |= said
        risen = air - self.air_at_start
        self.was_lifted |= is_asked & (risen > LIFTED_HEIGHT)
        self.dropped |= (self.was_lifted & (risen < LANDED_HEIGHT)).any(dim=1)
        self.before = positions.clone()

    def to_state(self) -> dict[str, torch.Tensor]:
        """As float32 tensors (N, D), which ManiSkill stores with a state; `restore` takes them back without loss."""
        # A float32 holds integers up to 2^24 only.
        halves = torch.stack([self.noise_seed >> 16, self.noise_seed & 0xFFFF], dim=1)
        tensors = {
            "asked": self.asked[:, None],
            "instances": self.instances,
            "was_lifted": self.was_lifted,
            "dropped": self.dropped[:, None],
            "start": self.start.flatten(1),
            "before": self.before.flatten(1),
            "air_at_start": self.air_at_start,
            "potential": self.potential[:, None],
            "noise_seed": halves,
            "visible_share": self.visible_share[:, None],
            "may_take": self.may_take,
        }
        if self.said_absent is not None:
            tensors["said_absent"] = self.said_absent[:, None]
        return {name: tensor.to(torch.float32, copy=True) for name, tensor in tensors.items()}

    def restore(self, state: dict[str, torch.Tensor], env_idx: torch.Tensor) -> None:
        """The inverse of `to_state`; rows of ``state`` are those of ``env_idx`` (M,)."""
        shape = (len(env_idx), *self.start.shape[1:])
        self.asked[env_idx] = state["asked"][:, 0].long()
        self.was_lifted[env_idx] = state["was_lifted"] > 0.5
        self.dropped[env_idx] = state["dropped"][:, 0] > 0.5
        self.start[env_idx] = state["start"].reshape(shape)
        self.before[env_idx] = state["before"].reshape(shape)
        self.air_at_start[env_idx] = state["air_at_start"]
        self.potential[env_idx] = state["potential"][:, 0]
        high, low = state["noise_seed"].long().unbind(dim=1)
        self.noise_seed[env_idx] = (high << 16) + low
        self.visible_share[env_idx] = state["visible_share"][:, 0]
        self.may_take[env_idx] = state["may_take"] > 0.5
        if self.said_absent is not None:
            self.said_absent[env_idx] = state["said_absent"][:, 0] > 0.5


def air_below(poses: torch.Tensor, hull_vertices: torch.Tensor) -> torch.Tensor:
    """Height of the lowest point of every object above the table, m, (N, K).

    poses: (N, K, 7) in the world frame, quaternions wxyz. hull_vertices: (N, K, V, 3) in the object frames.
    """
    third_row = quaternion_to_matrix(poses[..., 3:])[..., 2, :]
    return (hull_vertices @ third_row[..., None])[..., 0].min(dim=-1).values + poses[..., 2]


def judge(
    memory: Memory,
    is_asked: torch.Tensor,
    positions: torch.Tensor,
    air: torch.Tensor,
    held: torch.Tensor,
    control_freq: float,
    is_stranger: torch.Tensor | None = None,
) -> dict[str, torch.Tensor]:
    """What the present moment is, one value a sub-environment, (N,); the meaning of each key is in the task's card.

    is_asked, air, held: (N, K). positions: (N, K, 3) m. control_freq: Hz. is_stranger: (N, K), None without strangers.
    """
    speeds = torch.linalg.norm(positions - memory.before, dim=2) * control_freq
    asked_held = held & is_asked
    # With twins: the one in the hand, else the one that is highest up.
    carried = (air + 1e3 * asked_held).masked_fill(~is_asked, -torch.inf).argmax(dim=1, keepdim=True)
    wrong = ~is_asked & ~memory.may_take
    risen = air - memory.air_at_start
    lifted_wrongly = (risen > WRONG_LIFT_HEIGHT) & wrong
    wrong_object = lifted_wrongly.any(dim=1)
    off_table = (air < OFF_TABLE_HEIGHT).any(dim=1)
    fail = wrong_object | off_table
    success = (asked_held & (air >= LIFT_HEIGHT) & (speeds < STILL_SPEED)).any(dim=1)
    there = is_asked.any(dim=1)
    more: dict[str, torch.Tensor] = {}
    if is_stranger is not None:
        more["stranger_lifted"] = (lifted_wrongly & is_stranger).any(dim=1)
    if memory.said_absent is not None:
        more |= {"absent": ~there, "said_absent": memory.said_absent.clone()}
        fail = fail | (memory.said_absent & there)
        success = success | (memory.said_absent & ~there)
    shifted = torch.linalg.norm(positions - memory.start, dim=2)
    return {
        "success": success & ~fail,
        "fail": fail,
        "wrong_object": wrong_object,
        "off_table": off_table,
        "dropped": memory.dropped | (memory.was_lifted & (risen < LANDED_HEIGHT)).any(dim=1),
        "disturbance_m": shifted.masked_fill(is_asked, 0.0).amax(dim=1),
        "target_held": asked_held.any(dim=1),
        "wrong_held": (held & wrong).any(dim=1),
        "target_air": air.gather(1, carried)[:, 0].masked_fill(~there, 0.0),
        "target_speed": speeds.gather(1, carried)[:, 0].masked_fill(~there, 0.0),
        "visible_share": memory.visible_share.clone(),
        **more,
    }


def unflatten(flat: torch.Tensor, like: Mapping[str, Any], start: int = 0) -> tuple[dict[str, Any], int]:
    """Cuts (N, D) from column ``start`` on into the nested shape of ``like``; returns that and the next column."""
    result: dict[str, Any] = {}
    for key, value in like.items():
        if isinstance(value, Mapping):
            result[key], start = unflatten(flat, value, start)
        else:
            result[key], start = flat[:, start : start + value.shape[1]], start + value.shape[1]
    return result, start


def batched(state: Mapping[str, Any], device: torch.device) -> dict[str, Any]:
    """A nested state as tensors (N, D): ManiSkill's trajectories hold one state as arrays (D,)."""
    return {
        key: batched(value, device)
        if isinstance(value, Mapping)
        else torch.atleast_2d(torch.as_tensor(value)).to(device)
        for key, value in state.items()
    }
