"""The input cloud of a scene, organised (H, W, 3) or loose (N, 3), and the scene that it is cut into."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.errors import CloudError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SAME_SURFACE = 0.02  # m: within this a neighbouring pixel sees the same surface
GRIPPER_CONTACT = 0.01  # m


@dataclass(frozen=True)
class Rejected:
    """Something that is no object: what ("plane", "cluster", "points"), why, and the number of points concerned."""

    what: str
    why: str
    n_points: int


@dataclass(frozen=True)
class Scene:
    """The objects of a frame, the largest first; lists of one length.

    objects: clouds (M, 3) in the frame and dtype of the input. indices: of their points in the input, flattened.
    plane: (4,), n·p + d = 0 with n up, or None. touches_border: cut off by the image (never so for a loose cloud).
    touches_gripper: within 1 cm of it. rejected: what was left out and why. obstacles: clouds of those of it that a
    gripper could hit.
    """

    objects: list[FloatArray]
    indices: list[IntArray]
    plane: FloatArray | None
    touches_border: list[bool]
    touches_gripper: list[bool]
    rejected: list[Rejected] = field(default_factory=list)
    obstacles: list[FloatArray] = field(default_factory=list)

    def summary(self) -> str:
        """What was rejected, in a sentence."""
        parts = [f"{entry.what} of {entry.n_points} points: {entry.why}" for entry in self.rejected]
        return "; ".join(parts) if parts else "nothing was rejected"


class Frame:
    """The input cloud, and its valid points within the range of depth."""

    def __init__(self, cloud: ArrayLike, depth_range: tuple[float, float]) -> None:
        self.points, self.shape = _flattened(cloud)
        near, far = max(depth_range[0], 1e-6), depth_range[1]
        # NaN compares as false; infinity and values whose square overflows are beyond the range.
        with np.errstate(over="ignore", invalid="ignore"):
            squared = np.einsum("ij,ij->i", self.points, self.points)
            self.valid = np.flatnonzero((squared >= near * near) & (squared <= far * far))
        if not len(self.valid):
            raise CloudError(f"cloud: none of {len(self.points)} points is valid and {near:g} to {far:g} m away")
        self.inside = self.points[self.valid].astype(np.float64)

    def without_flying(self, chosen: IntArray) -> IntArray:
        """Those of the chosen points that do not hang in the air; all of them where the cloud is not organised."""
        if self.shape is None:
            return chosen
        return chosen[~flying_pixels(self.inside, self.valid, chosen, self.shape)]

    def scene(
        self,
        plane: FloatArray | None,
        kept: list[IntArray],
        obstacles: list[IntArray],
        hand: FloatArray | None,
        rejected: list[Rejected],
    ) -> Scene:
        indices = [self.valid[members] for members in kept]
        edge = None if self.shape is None else edge_of_view(self.valid, self.shape)
        return Scene(
            objects=[self.points[index] for index in indices],
            indices=indices,
            plane=plane,
            touches_border=[edge is not None and bool(edge[index].any()) for index in indices],
            touches_gripper=[hand is not None and _touch(self.inside[members], hand) for members in kept],
            rejected=rejected,
            obstacles=[self.points[self.valid[members]] for members in obstacles],
        )


def _flattened(cloud: ArrayLike) -> tuple[NDArray, tuple[int, int] | None]:
    """(N, 3) points in their floating type, and (H, W) where the cloud was organised."""
    try:
        points = np.asarray(cloud)
        if np.iscomplexobj(points):
            raise TypeError("complex numbers")
        if points.dtype not in (np.float32, np.float64):
            points = points.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise CloudError(f"cloud: not an array of numbers ({error})") from error
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise CloudError(f"cloud: shape {points.shape}, expected (N, 3) or (H, W, 3)")
    shape = (points.shape[0], points.shape[1]) if points.ndim == 3 else None
    return points.reshape(-1, 3), shape


def flying_pixels(inside: FloatArray, valid: IntArray, chosen: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which of the chosen points hang between two surfaces, as stereo and time of flight put them on edges.

    Fewer than two of such a pixel's eight neighbours are on the same surface. inside (V, 3): the valid points, whose
    flat indices in the frame are `valid` (V,); chosen (C,) indexes those. Returns (C,). Any frame will do.
    """
    rows, columns = shape
    stride = columns + 2
    place = np.full((rows + 2) * stride, -1, dtype=np.int32)
    y, x = np.divmod(valid, columns)
    at = (y + 1) * stride + x + 1
    place[at] = np.arange(len(valid), dtype=np.int32)
    at, own = at[chosen], inside[chosen]
    close = np.zeros(len(chosen), dtype=np.int8)
    for step in (-stride - 1, -stride, -stride + 1, -1, 1, stride - 1, stride, stride + 1):
        neighbour = place[at + step]
        difference = inside[neighbour] - own
        close += (np.einsum("ij,ij->i", difference, difference) < SAME_SURFACE**2) & (neighbour >= 0)
    return close < 2


def edge_of_view(valid: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(H · W,) pixels within two of the edge of that part of the image in which the sensor sees anything.

    Stereo sensors are blind in a band at one side: a row or column that is valid in less than a tenth is outside.
    """
    seen = np.zeros(shape, dtype=bool)
    seen.reshape(-1)[valid] = True
    edge = np.ones(shape, dtype=bool)
    rows = np.flatnonzero(seen.mean(axis=1) > 0.1)
    columns = np.flatnonzero(seen.mean(axis=0) > 0.1)
    if len(rows) and len(columns):
        edge[rows[0] + 2 : max(rows[-1] - 1, 0), columns[0] + 2 : max(columns[-1] - 1, 0)] = False
    return edge.reshape(-1)


def _touch(points: FloatArray, hand: FloatArray) -> bool:
    if not len(hand):
        return False
    nearest, _ = cKDTree(hand).query(points, k=1, distance_upper_bound=GRIPPER_CONTACT)
    return bool(np.isfinite(nearest).any())
