"""Whether the poses are different enough: turns about two axes or more, and no pose twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.calibration.errors import CalibrationError

WANTED_VIEWS = 15
WANTED_SPREAD = np.deg2rad(15.0)  # of turns about the second of the axes
LEAST_SPREAD = np.deg2rad(3.0)  # below it a corner's tenth of a pixel becomes centimetres
_NEAR_TURN, _NEAR_SHIFT = np.deg2rad(3.0), 0.01
_AXES = "xyz"


@dataclass(frozen=True)
class Variety:
    """axes: (3, 3), a row each, about which the mount turns between views, in its own frame, most first. spread: (3,)
    RMS of the turns between two views about each, rad. words: what is lacking, in plain English; empty: nothing.
    """

    axes: np.ndarray
    spread: np.ndarray
    words: list[str]


def variety_of(names: Sequence[str], T_mount_world: np.ndarray, mount: str) -> Variety:
    """Of poses (n, 4, 4), see `hand_eye`; mount: the name of the frame that carries the camera.

    Where all turns are about one axis the camera's place along it is free, and a turn of it about it (Tsai and Lenz
    1989): CalibrationError.
    """
    rotations = Rotation.from_matrix(T_mount_world[:, :3, :3])
    first, second = np.triu_indices(len(names), 1)
    turns = (rotations[first] * rotations[second].inv()).as_rotvec()
    values, vectors = np.linalg.eigh(turns.T @ turns / max(1, len(turns)))
    spread, axes = np.sqrt(np.maximum(values[::-1], 0)), vectors.T[::-1]
    if spread[1] < LEAST_SPREAD:
        raise CalibrationError(
            f"the poses turn {mount} about one axis only, near {_named(axes[0])}, by {np.degrees(spread[0]):.0f}°, and "
            f"about others by {np.degrees(spread[1]):.1f}°: turn it about {_named(axes[1])} as well, by 20° and more "
            "either way"
        )
    words = []
    if spread[1] < WANTED_SPREAD:
        words.append(
            f"turns of {mount} about {_named(axes[1])} spread by {np.degrees(spread[1]):.0f}° only: add views turned "
            f"about it by 20 to 30° either way, so that two axes spread by {np.degrees(WANTED_SPREAD):.0f}°"
        )
    if len(names) < WANTED_VIEWS:
        words.append(f"{len(names)} views: {WANTED_VIEWS} to 20 average more of the noise away")
    shifts = np.linalg.norm(T_mount_world[first, :3, 3] - T_mount_world[second, :3, 3], axis=1)
    near = (np.linalg.norm(turns, axis=1) < _NEAR_TURN) & (shifts < _NEAR_SHIFT)
    words += [
        f"{names[b]} nearly repeats {names[a]}: it adds little" for a, b in zip(first[near], second[near], strict=True)
    ]
    return Variety(axes, spread, words)


def _named(axis: np.ndarray) -> str:
    """In words: "its x", or a direction between the axes."""
    largest = int(np.argmax(np.abs(axis)))
    if abs(axis[largest]) > 0.9:
        return f"its {_AXES[largest]}"
    return "its direction (" + ", ".join(f"{value + 0.0:.1f}" for value in axis * np.sign(axis[largest])) + ")"
