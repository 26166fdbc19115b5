"""What an episode starts with: which class is asked for, how the objects lie, and how much of that one is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pecgrasp_env.envs.validation import SceneOptions, TaskError
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.scene.actors import SceneObjects, Wish
from pecgrasp_env.scene.clutter import BIN, lay_out
from pecgrasp_env.scene.placement import REGION, WIDE_REGION
from pecgrasp_env.scene.visibility import Mesh, box_mesh, placed_mesh, visible_shares
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_MOST_IN_REGION = 5  # more objects are laid out in the wide one, and strangers, which may be as large as plates


@dataclass(frozen=True)
class EpisodeStart:
    """asked: index of the class that is asked for. poses: (K, 7) of the objects, world frame, m and quaternion wxyz.
    joint_offsets: (6,) rad, of the arm from its home posture.
    """

    asked: int
    poses: np.ndarray
    joint_offsets: np.ndarray


def draw_start(
    table: SceneObjects,
    env_index: int,
    layout: SceneOptions,
    wish: Wish,
    rng: np.random.Generator,
    absence: np.random.Generator | None,
) -> EpisodeStart:
    """The start of an episode of one sub-environment.

    absence: draws whether the asked-for class is away; None where it never is. Raises PlacementError where the objects
    do not fit, TaskError where every class lies there though one is to be away.
    """
    models = table.models[env_index]
    asked = int(table.slot_class[env_index, int(rng.choice(table.askable[env_index]))])
    if wish.target is not None:
        asked = wish.target
    elif absence is not None:
        asked = _asked_or_away(table.away(env_index), asked, float(layout.absent), wish.absent, absence)
    region = REGION if len(models) <= _MOST_IN_REGION and not layout.n_strangers else WIDE_REGION
    poses = lay_out(models, rng, region, layout.clutter, layout.clearance)
    return EpisodeStart(asked, poses, rng.uniform(-layout.joint_noise, layout.joint_noise, size=6))


def _asked_or_away(
    away: Sequence[int], asked: int, chance: float, absent: bool | None, rng: np.random.Generator
) -> int:
    """The class ``asked``, or one of those that lie not there, by chance or as it is said."""
    is_away = bool(rng.random() < chance) if absent is None else absent
    if is_away and not away and (absent or chance == 1):
        raise TaskError("absent: every class lies on the table; name objects of fewer classes, or name the target")
    return int(rng.choice(away)) if is_away and away else asked


def visible_share(
    models: Sequence[ObjectModel],
    poses: np.ndarray,
    is_asked: Sequence[bool],
    fixed: Sequence[Mesh],
    T_world_camera: np.ndarray,
    intrinsics: CameraIntrinsics,
) -> float:
    """How much of the asked-for object the camera sees, of twins of the one that is seen better; 0 where there is none.

    poses: (K, 7), world frame. fixed: what else stands there. T_world_camera: (4, 4), OpenCV axes.
    """
    meshes = [placed_mesh(model, pose) for model, pose in zip(models, poses, strict=True)]
    shares = visible_shares([*meshes, *fixed], T_world_camera, intrinsics)
    return max((float(shares[k]) for k, asked in enumerate(is_asked) if asked), default=0.0)


def fixed_meshes(clutter: str) -> list[Mesh]:
    """What stands on the table beside the objects and may hide them."""
    return [box_mesh(*box) for box in BIN.boxes()] if clutter == "bin" else []
