"""Jain and Argall (2016): the whole object is one primitive, and that is held from its side or its top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import require_between
from grasping.geometry.primitives import FLAT, primitive_of
from grasping.geometry.principal_axes import inward_axis, object_axes, principal_axes
from grasping.geometry.sampling import thinned
from grasping.geometry.surface_variation import surface_variation
from grasping.grasp import Grasp, GraspPlan, Primitive, RegionReport, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.validation import object_cloud, sight, workspace

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class _Fit:
    """A primitive: centre (3,), size (3,) m along the columns of axes (3, 3): long, short, and away from the table."""

    name: Primitive
    centre: FloatArray
    axes: FloatArray
    size: FloatArray

    @property
    def stands(self) -> bool:
        return bool(self.size[2] > self.size[0])


class SinglePrimitivePlanner:
    """Δ of the whole object names a sphere, a cylinder or a box, which is held at its centre from its side or top.

    The names follow from Δ as in the dissertation: the share of points with σ ≤ 0.01, sphere below 0.10, cylinder below
    0.40, box above. It fails, by construction, on objects of several parts.

    What the source leaves open, or we could not find:

    n_points: the cloud is thinned to this many points (256, as for the dissertation's planner).
    neighbour_divisor: σ is taken over k = N / neighbour_divisor points, at least 3. 6 is the dissertation's rule with
        the whole object as the one region. On ideal one-sided clouds it puts spheres (Δ 0.02–0.04) and cans
        (0.15–0.29) where they belong, and cuboids (0.33–0.42) about the border of 0.40.
    tip_clearance: the fingers are kept this far above a known table, m.

    Size: a box has its extents along its axes. The back of an object is unseen, which shortens one extent, so the
    greater of the two across a cylinder is its diameter, the middle one of a sphere's three. A known table is the
    primitive's underside.
    Axes: with `up`, that and the two principal axes of the footprint, since an object rests on a face; without, the
    principal axes, the thinnest one taken for up. A cylinder's axis is up where it is taller than long, else the long
    one.
    Side or top: what is taller than long is held from its side first, anything else from its top; the other kind
    follows. Pads close along a level axis (a finger does not fit under an object), the narrow one first.

    Terms of a grasp: `side`, 1 from the side and 0 from the top; `flat`, Δ; `narrow`, 1 - width / stroke.
    Score: half of `narrow`, and 0.5 more for the kind that comes first.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        n_points: int = 256,
        neighbour_divisor: int = 6,
        tip_clearance: float = 0.004,
    ) -> None:
        require_between("n_points", n_points, 16, 10**5)
        require_between("neighbour_divisor", neighbour_divisor, 1, 10**5)
        require_between("tip_clearance", tip_clearance, 0.0, 0.1)
        self.gripper = gripper
        self.n_points = n_points
        self.neighbour_divisor = neighbour_divisor
        self.tip_clearance = tip_clearance

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
        unseen: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m. Obstacles are checked for sense, but not avoided; what was
        not seen (viewpoint, unseen) counts as free.

        Raises CloudError for a cloud, ConfigError for a scene that is none.
        """
        cloud = object_cloud(points)
        up_vector, plane, _ = workspace(up, table, obstacles)
        sight(viewpoint, unseen)
        cloud = thinned(cloud, self.n_points)
        sigma = surface_variation(cloud, max(3, len(cloud) // self.neighbour_divisor))
        fit = _fit(cloud, primitive_of(sigma), up_vector, plane)
        flat = float(np.mean(sigma <= FLAT))
        candidates = [
            self._grasp(fit, approach, closing, flat, plane)
            for approach, closing in _ways(fit, cloud)
            if fit.size[closing] <= self.gripper.stroke
        ]
        across = float(fit.size[:2].min())
        wide, most = across * 1e3, self.gripper.stroke * 1e3
        x = (cloud - fit.centre) @ fit.axes[:, 1]
        lateral = float(sigma[[int(x.argmin()), int(x.argmax())]].sum())
        verdict = "candidate" if candidates else f"too wide: {wide:.0f} mm"
        region = RegionReport(cloud, fit.name, across, lateral, verdict, slab=0)
        reason = f"the object is one {fit.name}, {wide:.0f} mm across; the gripper opens {most:.0f} mm"
        return plan_from(candidates, [region], reason)

    def _grasp(self, fit: _Fit, approach: FloatArray, closing: int, flat: float, plane: FloatArray | None) -> Grasp:
        """Hold the centre of the primitive with this approach (3,), closing along this one of its axes."""
        side = abs(float(approach @ fit.axes[:, 2])) < 0.5
        across = fit.axes[:, closing]
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([across, np.cross(approach, across), approach])
        pose[:3, 3] = fit.centre
        if plane is not None:
            below = 0.5 * (self.gripper.finger_width if side else self.gripper.pad_length)
            height = float(plane[:3] @ fit.centre + plane[3]) - below
            pose[:3, 3] += max(0.0, self.tip_clearance - height) * plane[:3]
        width = float(fit.size[closing])
        narrow = 1.0 - width / self.gripper.stroke
        score = 0.5 * narrow + 0.5 * (side == fit.stands)
        return Grasp(pose, width, score, "primitive", None, {"side": float(side), "flat": flat, "narrow": narrow})


def _fit(cloud: FloatArray, name: Primitive, up: FloatArray | None, plane: FloatArray | None) -> _Fit:
    """The primitive of this name round the cloud (N, 3); see the planner for the rules."""
    if up is None:
        own = object_axes(cloud)
        away = -inward_axis(cloud, own[:, 2])
        axes = np.column_stack([own[:, 1], np.cross(away, own[:, 1]), away])
    else:
        seed = np.eye(3)[int(np.abs(up).argmin())]
        level = np.cross(up, seed) / np.linalg.norm(np.cross(up, seed))
        footprint = np.column_stack([level, np.cross(up, level)])
        long = footprint @ principal_axes(cloud @ footprint)[:, 0]
        axes = np.column_stack([long, np.cross(up, long), up])
    local = cloud @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    if plane is not None:
        low[2] = min(low[2], -plane[3])  # the table's height along its own normal
    size = high - low
    if name == "sphere":
        size[:] = np.median(size)
    elif name == "cylinder":
        around = [0, 1] if size[2] > size[0] else [1, 2]
        size[around] = size[around].max()
    return _Fit(name, axes @ (0.5 * (low + high)), axes, size)


def _ways(fit: _Fit, cloud: FloatArray) -> list[tuple[FloatArray, int]]:
    """(approach (3,), index of the closing axis): from the top, and from both ends of either level axis."""
    ways: list[tuple[FloatArray, int]] = [(-fit.axes[:, 2], 1), (-fit.axes[:, 2], 0)]
    for closing in (1, 0):
        inward = inward_axis(cloud, fit.axes[:, 1 - closing])
        ways += [(inward, closing), (-inward, closing)]
    return ways
