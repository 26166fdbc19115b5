"""What stands around the objects, and from where it is looked at: tables of all sizes, floor, walls, cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Box", "Room", "draw_room"]

_SIDEWAYS = np.radians(75.0)  # of the camera, from straight before the wall


@dataclass(frozen=True)
class Box:
    """Half size (3,) and centre (3,), m, and its turn about the vertical, rad; world frame."""

    half_size: np.ndarray
    centre: np.ndarray
    yaw: float = 0.0


@dataclass(frozen=True)
class Room:
    """table: its top is z = 0. others: floor, walls and what stands about. azimuths: of cameras, before walls."""

    table: Box
    others: tuple[Box, ...]
    azimuths: tuple[float, float]


def draw_room(points: np.ndarray, rng: np.random.Generator) -> Room:
    """A room round objects whose outlines on the table are points (K, 2): all of them are on it.

    The table ends from 10 mm to a metre beyond them; one scene in eight lies on the floor itself. In half of the rooms
    there are walls, and in some of them boxes stand about behind the table.
    """
    facing = float(rng.uniform(-np.pi, np.pi))
    c, s = np.cos(facing), np.sin(facing)
    axes = np.array([[c, -s], [s, c]])  # local → world; local x towards the wall
    local = points @ axes
    margins = np.exp(rng.uniform(np.log(0.01), np.log(1.0), (2, 2)))
    low, high = local.min(axis=0) - margins[0], local.max(axis=0) + margins[1]
    on_floor = rng.random() < 0.125
    if on_floor:
        low, high = low - 3, high + 3
    thick = rng.uniform(0.015, 0.06)

    def box(low3: Sequence[float], high3: Sequence[float], yaw: float = 0.0) -> Box:
        lower, upper = np.array(low3), np.array(high3)
        middle = (lower + upper) / 2
        return Box((upper - lower) / 2, np.append(axes @ middle[:2], middle[2]), facing + yaw)

    table = box([*low, -thick], [*high, 0.0])
    least, most = facing + np.pi - _SIDEWAYS, facing + np.pi + _SIDEWAYS
    drop = 0.0 if on_floor else rng.uniform(0.35, 0.9)
    others = [] if on_floor else [box([-6, -6, -drop - 0.1], [6, 6, -drop])]
    if rng.random() < 0.5:
        near = high[0] + np.exp(rng.uniform(np.log(0.02), np.log(2.0)))
        others.append(box([near, -6, -drop], [near + 0.1, 6, 3]))
        if rng.random() < 0.4:  # a corner
            side = rng.choice([-1, 1])
            at = (high[1] if side > 0 else -low[1]) + np.exp(rng.uniform(np.log(0.07), np.log(1.5)))
            others.append(box([-0.3, side * at - 0.05, -drop], [near, side * at + 0.05, 3]))
            least, most = (facing + np.pi, most) if side > 0 else (least, facing + np.pi)
    for _ in range(rng.poisson(0.7)):
        size, place = rng.uniform(0.1, 0.6, 3), np.array([high[0] + rng.uniform(0.1, 1.2), rng.uniform(-1.0, 1.0)])
        place[0] += size[0]
        others.append(
            box([*(place - size[:2] / 2), -drop], [*(place + size[:2] / 2), 2 * size[2] - drop], rng.normal())
        )
    return Room(table, tuple(others), (least, most))
