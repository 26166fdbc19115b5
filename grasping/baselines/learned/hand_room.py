"""How far an open hand comes along its approach until something is in its way, and what is then between its pads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.gripper import Gripper

FloatArray = NDArray[np.float64]

PALM_CLEARANCE = 0.01  # m between the palm and whatever is under it
_AT_ONCE = 2_000_000  # products of hands and points that are held in memory together


@dataclass(frozen=True)
class HandRoom:
    """Of M hands: advance (M,), m, from where they are along their approach to the deepest place that is free, −inf
    where none is; reach (M,), m, how far the tips are there past the first point between the fingers, ≤ 0 where nothing
    is; middle (M,), m, along the closing direction, and width (M,), m, of the points between the fingers down to the
    tips, 0 where there is none.
    """

    advance: FloatArray
    reach: FloatArray
    middle: FloatArray
    width: FloatArray


class HandSpace:
    """The cloud (N, 3) of an object, those of others (K, 3), and a table (4,), all m in one frame.

    tip_clearance: of the open hand above the table, m.
    """

    def __init__(
        self,
        gripper: Gripper,
        cloud: FloatArray,
        obstacles: FloatArray,
        table: FloatArray | None,
        tip_clearance: float,
    ) -> None:
        self._gripper, self._table, self._tip_clearance = gripper, table, tip_clearance
        self._all = np.concatenate([cloud, obstacles])
        self._own = np.arange(len(self._all)) < len(cloud)
        self._half_length = 0.5 * gripper.pad_length
        self._reach = gripper.pad_depth(gripper.stroke) + self._half_length - gripper.palm_depth

    def room(self, rotations: FloatArray, origins: FloatArray, openings: FloatArray, farthest: float) -> HandRoom:
        """Of hands with rotations (M, 3, 3), pads' centres (M, 3) and openings (M,), m, that advance by `farthest`, m,
        at most."""
        step = max(1, _AT_ONCE // max(1, len(self._all)))
        parts = [
            self._some(rotations[k : k + step], origins[k : k + step], openings[k : k + step], farthest)
            for k in range(0, max(1, len(origins)), step)
        ]
        return HandRoom(*(np.concatenate([np.empty(0), *values]) for values in zip(*parts, strict=True)))

    def _some(
        self, rotations: FloatArray, origins: FloatArray, openings: FloatArray, farthest: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        x, y, z = np.moveaxis((self._all - origins[:, None]) @ rotations, 2, 0)
        hand, half = self._gripper, 0.5 * openings[:, None]
        outside = np.abs(x) - half
        in_line = np.abs(y) <= 0.5 * hand.finger_width
        in_fingers = in_line & (outside > 0.0) & (outside <= hand.finger_thickness)
        under_palm = (np.abs(y) <= 0.5 * max(hand.palm_breadth, hand.finger_width)) & (outside <= 0.0)
        advance = np.minimum(
            np.min(z, axis=1, where=in_fingers, initial=np.inf) - self._half_length,
            np.min(z, axis=1, where=under_palm, initial=np.inf) - self._half_length + self._reach - PALM_CLEARANCE,
        )
        advance = np.minimum(np.minimum(advance, farthest), self._above_table(rotations, origins, openings))
        between = in_line & (outside <= 0.0) & self._own
        tips = advance + self._half_length
        reach = tips - np.min(z, axis=1, where=between, initial=np.inf)
        held = between & (z <= tips[:, None])
        low = np.min(x, axis=1, where=held, initial=np.inf)
        high = np.max(x, axis=1, where=held, initial=-np.inf)
        some = high >= low
        low, high = np.where(some, low, 0.0), np.where(some, high, 0.0)
        return advance, reach, 0.5 * (low + high), high - low

    def _above_table(self, rotations: FloatArray, origins: FloatArray, openings: FloatArray) -> FloatArray:
        """(M,) m that each hand can advance until a corner of its fingers or palm comes too near the table."""
        if self._table is None:
            return np.full(len(origins), np.inf)
        hand, normal = self._gripper, self._table[:3]
        x, y = 0.5 * openings + hand.finger_thickness, 0.5 * hand.finger_width
        palm = max(0.5 * hand.palm_breadth, y)
        lateral = np.abs(rotations[:, :, 0] @ normal) * x
        descent = -(rotations[:, :, 2] @ normal)
        height = origins @ normal + self._table[3] - lateral
        beside = np.abs(rotations[:, :, 1] @ normal)
        tips = height - beside * y - descent * self._half_length
        wrist = height - beside * palm + descent * (self._reach - self._half_length)
        room = np.minimum(tips, wrist) - self._tip_clearance
        falls = descent > 1e-3
        return np.where(falls, room / np.where(falls, descent, 1.0), np.where(room >= 0.0, np.inf, -np.inf))
