"""An arm of six joints as numbers: the lengths of its type, and those of the one arm where its maker measured them.

The types are Universal Robots', whose shoulder, elbow and first wrist joint are parallel: the closed form of
`kinematics` needs that. What a factory measures of one arm moves the tool by some millimetres against it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

# a (m), d (m), alpha (rad): standard Denavit-Hartenberg, of Universal Robots' UR5 (CB3)
DH = np.array(
    [
        [0.0, 0.089159, np.pi / 2],
        [-0.42500, 0.0, 0.0],
        [-0.39225, 0.0, 0.0],
        [0.0, 0.10915, np.pi / 2],
        [0.0, 0.09465, -np.pi / 2],
        [0.0, 0.0823, 0.0],
    ]
)
# The elbow could turn ±2π too; ±π is the usual choice for planning and loses no pose.
JOINT_LIMITS = np.array([[-2 * np.pi, 2 * np.pi]] * 2 + [[-np.pi, np.pi]] + [[-2 * np.pi, 2 * np.pi]] * 3)
_FOOTPRINT_M = 0.149
_ANGLES = np.array([[np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]]).T
_NO_LENGTH = np.array([[1, 0], [0, 1], [0, 1], [1, 0], [1, 0], [1, 0]], bool)  # of a and d


@dataclass(frozen=True, eq=False)
class ArmLengths:
    """dh: (6, 3) a, d [m] and alpha [rad] of each joint of the type. limits: (6, 2) rad. footprint: m, diameter of its
    base, by which the links' thickness is told. measured: (6, 4) theta [rad], to be added to the joint's angle, a, d
    [m] and alpha [rad] of this one arm; None where they are not known. Raises ValueError where the joints stand to each
    other otherwise than a UR's.
    """

    dh: np.ndarray
    limits: np.ndarray
    footprint: float
    measured: np.ndarray | None = None

    def __post_init__(self) -> None:
        off = np.abs(self.dh[:, 2:] - _ANGLES).max() > 1e-6 or np.abs(self.dh[:, :2][_NO_LENGTH]).max() > 1e-9
        if off:
            raise ValueError(
                f"dh: joints 2 to 4 parallel and a wrist of three, as a UR has them; got {self.dh.tolist()}"
            )

    def with_measured(self, measured: np.ndarray | None) -> ArmLengths:
        """The same type, another arm."""
        return replace(self, measured=measured)

    @cached_property
    def share(self) -> float:
        """Of the UR5's reach, at most 1, in hundredths: where the arm looks and carries is nearer by it."""
        reach = np.abs(self.dh[1:3, 0]).sum() / np.abs(DH[1:3, 0]).sum()
        return float(min(1.0, np.round(reach, 2)))

    @cached_property
    def thickness(self) -> float:
        """Of the links, times the UR5's."""
        return self.footprint / _FOOTPRINT_M


UR5 = ArmLengths(DH, JOINT_LIMITS, _FOOTPRINT_M)
