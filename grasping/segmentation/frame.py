"""The input cloud of a scene, organised (H, W, 3) or loose (N, 3), and the scene that it is cut into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import CloudError
from grasping.segmentation import kernels
from grasping.segmentation.edge_of_view import EdgeOfView
from grasping.segmentation.flying_pixels import edge_owners, ramps, single_pixels
from grasping.segmentation.lines_of_sight import LinesOfSight
from grasping.segmentation.planes import Plane, heights_above
from grasping.segmentation.robot_body import RobotBody
from grasping.segmentation.scene import OnDemand, Rejected, Scene
from grasping.segmentation.table_plane import SAMPLED, View, find_table
from grasping.segmentation.working_image import FEWEST, UNTOLD_BEHIND, WorkingImage, loose_image, organised_image
from grasping.validation import FARTHEST, position

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GRIPPER_CONTACT = 0.01  # m
ALONG_Z = 0.94  # of up, where that is what a world frame's z axis is
USUAL = 0.7  # of the way to a loose cloud's middle goes along its z axis, where that is a camera's frame
AHEAD = 0.5  # of the way along z to almost every point, in a frame that is surely a camera's
NOTICED = 0.01  # of the points; fewer are left out without a way to have them
NO_CAMERA = "seen from the cloud's origin much of it would lie behind the rest: say where the camera stood (viewpoint)"
LOWEST_CAMERA = 0.05  # m above the table


class Frame:
    """The input cloud, and which of its points are valid and within the range of depth.

    points: (N, 3) in the input's type. shape: (H, W) where it was organised. valid: (N,). Everywhere else points are
    named by their index in this cloud. viewpoint: (3,) where the camera stood, None: in the cloud's origin. robot: what
    `RobotBody` takes; its points are not valid.
    """

    def __init__(
        self,
        cloud: ArrayLike,
        depth_range: tuple[float, float],
        viewpoint: ArrayLike | None = None,
        robot: ArrayLike | None = None,
    ) -> None:
        self.points, self.shape = _flattened(cloud)
        self._robot = None if robot is None else RobotBody(robot)
        self._viewpoint = None if viewpoint is None else position(viewpoint, name="viewpoint")
        self._origin = np.zeros(3) if self._viewpoint is None else self._viewpoint
        near, far = max(depth_range[0], 1e-6), depth_range[1]
        where = f"{depth_range[0]:g} to {far:g} m away"
        squared, self.valid = distances(self.points, near, far)
        self._squared = squared
        self._holes = ~(squared > 0)  # NaN, or the zero that stands for nothing measured
        own = np.zeros(len(self.points), dtype=bool)
        if self._robot is not None:
            own[self._robot.within(np.ascontiguousarray(self.points.T).T)] = True  # columns are faster to ask
            own &= ~self._holes
            self.valid &= ~own
        self._hidden = self._holes | own  # what stands there was not seen
        self.count = int(np.count_nonzero(self.valid))
        if not self.count:
            measured = squared[np.isfinite(squared) & (squared > 0) & ~own]
            raise CloudError(
                f"cloud: none of {len(self.points)} points is valid and {where} from its origin"
                + (f", without {np.count_nonzero(own)} of the robot itself" if own.any() else "")
                + _all_beyond(measured)
            )
        self._no_camera = False
        self.rejected: list[Rejected] = []
        self.other_planes: list[FloatArray] = []
        self.reject("points", "no depth", np.flatnonzero(self._holes))
        self.reject("points", "the robot itself", np.flatnonzero(own))
        beyond = np.flatnonzero(~self.valid & ~self._hidden)
        way_out = ""
        if len(beyond) > NOTICED * (len(beyond) + self.count):
            farthest = float(np.quantile(squared[np.isfinite(squared) & ~own], 0.99)) ** 0.5
            way_out = f"depth_range=[0,{math.ceil(2 * max(farthest, far)) / 2:g}]" if farthest < FARTHEST else ""
        self.reject("points", f"not {where}", beyond, way_out)

    def reject(self, what: str, why: str, points: IntArray | int, way_out: str = "") -> None:
        """Note what is left out, where there is any of it, and the setting that would take it.

        points: their indices, or of a plane how many there are.
        """
        if isinstance(points, int):
            if points:
                self.rejected.append(Rejected(what, why, points, way_out))
        elif len(points):
            self.rejected.append(Rejected(what, why, len(points), way_out, points))

    def sample(self, most: int, rng: np.random.Generator) -> FloatArray:
        """(M, 3) float64: the valid points, or as many of them as suffice, drawn at random."""
        index = np.flatnonzero(self.valid)
        if self.count > most:
            index = index[rng.integers(0, self.count, size=most)]
        return self.points.take(index, axis=0).astype(np.float64)

    def heights(self, plane: FloatArray) -> NDArray:
        """(N,) above a plane (4,), m; NaN where the point is not valid."""
        return heights_above(self.points, self.valid, plane)

    def without_flying(self, chosen: IntArray, plane: FloatArray | None = None) -> tuple[IntArray, IntArray]:
        """Those of the chosen points that do not hang in the air, and those on ramps, which may be an object's edge.

        plane: (4,) the table, where there is one. A cloud that is not organised keeps all of its points.
        """
        if self.shape is None:
            return chosen, np.empty(0, dtype=np.int64)
        flying = single_pixels(self.points, chosen, self.shape)
        self.reject("points", "in the air at an edge", chosen[flying])
        chosen = chosen[~flying]
        if self.sight is None:
            return chosen, np.empty(0, dtype=np.int64)
        on_ramp = ramps(self.points, self._distance, chosen, self.shape, self.sight, plane)
        return chosen[~on_ramp], chosen[on_ramp]

    def with_edges(self, kept: list[IntArray], on_ramps: IntArray) -> list[IntArray]:
        """The objects with those points on ramps that adjoin them; the others hang in the air."""
        if not len(on_ramps) or self.shape is None:
            return kept
        owners = edge_owners(self.points, kept, on_ramps, self.shape[1])
        self.reject("points", "on a ramp between two surfaces", on_ramps[owners < 0])
        own = [on_ramps[owners == number] for number in range(len(kept))]
        return [np.sort(np.append(a, b)) if len(b) else a for a, b in zip(kept, own, strict=True)]

    @cached_property
    def sight(self) -> LinesOfSight | None:
        """The camera of an organised frame, where its points say that it stood where it is said to."""
        if self.shape is None:
            return None
        lines = LinesOfSight(self.points, self.valid, self.shape, self._origin)
        return lines if lines.fits else None

    def find_table(
        self, up: FloatArray | None, rng: np.random.Generator, coarse: float, band: tuple[float, float]
    ) -> Plane | str:
        """The table, or why there is none; what other planes there are is noted."""
        sample = self.sample(SAMPLED, np.random.default_rng(0))  # the same whatever the draws
        found = find_table(
            sample - self._origin,
            up,
            rng,
            coarse=coarse,
            band=band,
            view=self._view(sample),
            seen_from_origin=self.sight is not None or self._viewpoint is not None,
        )
        self._told_up = up is not None
        for other in found.others:
            self.reject("plane", other.where, round(other.share * self.count))
            self.other_planes.append(self._back(other.plane).equation)
        if isinstance(found.table, str):
            way_out = "" if up is None else "up=[x,y,z]"
            self.rejected.insert(0, Rejected("plane", found.table, self.count, way_out))
            return found.table
        table = self._back(found.table)
        if up is None and self._viewpoint is None and table.equation[3] < LOWEST_CAMERA:
            why = "no camera can stand at the cloud's origin, under the table: this is no camera's frame"
            self.reject("plane", why, self.count, _up_setting(table.equation))
        return table

    def reject_below(self, plane: FloatArray, points: IntArray) -> None:
        """Note what lies below the table, and that up may be elsewhere where only the plane says where it is."""
        unsure = not self._told_up and self.sight is None and len(points) > NOTICED * self.count
        self.reject("points", "below the table", points, _up_setting(-plane) if unsure else "")

    def _back(self, plane: Plane) -> Plane:
        """A plane of the frame that has the viewpoint as its origin, in the cloud's own."""
        n, d = plane.equation[:3], plane.equation[3]
        return replace(plane, equation=np.append(n, d - n @ self._origin))

    def _view(self, sample: FloatArray) -> View | None:
        """How the camera looks: as the pixels say, or a camera's frame as it is usual; None in another frame."""
        if self.sight is not None:
            return View(*self.sight.axes)
        if self.shape is not None:
            return None
        middle = sample.mean(axis=0)
        ahead = float(middle[2]) / max(float(np.linalg.norm(middle)), 1e-9)
        if abs(ahead) < USUAL:
            return None
        side = np.sign(ahead)  # x right, y down, z forward; or x right, y up, z backward
        return View(np.array([0.0, side, 0.0]), np.array([0.0, 0.0, side]))

    def working_image(self, plane: FloatArray | None, chosen: NDArray[np.bool_] | None = None) -> WorkingImage | None:
        """What surfaces are told apart in; None where nobody knows from where the points were seen.

        plane: (4,) the table, where there is one. chosen: (N,) the points that count, by default the valid ones.
        """
        chosen = self.valid if chosen is None else chosen
        if self.sight is not None:
            return organised_image(self.points, chosen, self.sight.shape, self.sight)
        if self._viewpoint is None and (self.shape is not None or not self._of_a_camera(plane)):
            return None
        up = None if plane is None else plane[:3]
        if self._viewpoint is not None:
            return loose_image(self.points, chosen, self._origin, up)
        image = loose_image(self.points, chosen, self._origin, up, UNTOLD_BEHIND)
        if image is None and np.count_nonzero(chosen) >= FEWEST:
            self._no_camera = True
            self.reject("plane", NO_CAMERA, self.count)
        return image

    def _of_a_camera(self, plane: FloatArray | None) -> bool:
        """Whether a loose cloud's frame is surely a camera's: all of it lies ahead along z, and no table above it."""
        if plane is not None and plane[3] < LOWEST_CAMERA:
            return False
        seen = self.sample(SAMPLED, np.random.default_rng(0))
        ahead = seen[:, 2] / np.linalg.norm(seen, axis=1)
        return bool(np.quantile(np.sign(ahead.mean()) * ahead, 0.01) > AHEAD)

    def area(self, index: IntArray, pitch: float) -> float:
        """How large what these points show is across the line of sight, m². pitch: m between points of the table."""
        if self.sight is None:
            return len(index) * pitch**2
        across = self.points.take(index, axis=0) - self.sight.viewpoint.astype(self.points.dtype)
        return float(np.einsum("ij,ij->", across, across)) * self.sight.pixel**2

    def measured(self) -> tuple[NDArray[np.bool_], NDArray, NDArray]:
        """Of an organised frame: where nothing was measured (H, W), its points (H·W, 3) and how far away, m (H·W,)."""
        assert self.shape is not None
        return self._hidden.reshape(self.shape), self.points, self._distance

    @cached_property
    def _distance(self) -> NDArray:
        """(N,) from the viewpoint, m, of all points, whatever their range; NaN where nothing was measured."""
        squared = self._squared
        if self._viewpoint is not None:
            apart = self.points - self._viewpoint.astype(self.points.dtype)
            with np.errstate(over="ignore", invalid="ignore"):
                squared = np.einsum("ij,ij->i", apart, apart)
        distance = np.sqrt(squared)
        distance[self._holes] = np.nan
        return np.asarray(distance)

    def scene(
        self,
        plane: FloatArray | None,
        kept: list[IntArray],
        obstacles: list[IntArray],
        n_table: int,
    ) -> Scene:
        clouds = [self.points.take(index, axis=0) for index in kept]
        viewpoint, unseen = self._seen_from(plane, kept, clouds)
        return Scene(
            objects=clouds,
            indices=kept,
            plane=plane,
            touches_border=[self.cut_off(index) for index in kept],
            touches_gripper=self._touching_robot(clouds),
            rejected=self.rejected,
            obstacles=[self.points.take(index, axis=0) for index in obstacles],
            n_table=n_table,
            viewpoint=viewpoint,
            unseen=unseen,
            other_planes=self.other_planes,
        )

    def _seen_from(
        self, plane: FloatArray | None, kept: list[IntArray], clouds: list[NDArray]
    ) -> tuple[FloatArray | None, Sequence[FloatArray]]:
        """Where the camera stood, if that is known, and for each object the far ends of the lines that met nothing."""
        nothing = [np.empty((0, 3)) for _ in kept]
        if self._no_camera or (self._viewpoint is None and plane is not None and plane[3] < LOWEST_CAMERA):
            return None, nothing  # a frame of the world: no camera looks from under the table, or through things
        if self.shape is None:
            return self._origin, nothing
        if self.sight is None:
            return self._viewpoint, nothing
        objects = zip(kept, clouds, strict=True)
        return self._origin, OnDemand([partial(self.sight.unseen, self._hidden, *each, plane) for each in objects])

    def cut_off(self, index: IntArray) -> bool:
        """Whether what these points show goes on beyond the view; never so for a loose cloud."""
        return self._edge is not None and self._edge.cuts(index)

    @cached_property
    def _edge(self) -> EdgeOfView | None:
        return None if self.shape is None else EdgeOfView(self.valid.reshape(self.shape))

    def _touching_robot(self, clouds: Sequence[NDArray]) -> list[bool]:
        """Which of the objects, by their points (M, 3), the robot touches; asked for all at once."""
        if self._robot is None or not clouds:
            return [False] * len(clouds)
        touching = np.zeros(sum(map(len, clouds)), dtype=bool)
        touching[self._robot.within(np.concatenate(clouds), GRIPPER_CONTACT)] = True
        ends = np.cumsum([len(points) for points in clouds])
        return [bool(each.any()) for each in np.split(touching, ends[:-1])]


def distances(points: NDArray, near: float, far: float) -> tuple[NDArray, NDArray[np.bool_]]:
    """(N,) each: of points (N, 3) the squared distances from the origin, in their own type, and which are within range.

    NaN is not; infinity and values whose square overflows are beyond it.
    """
    if kernels.compiled is None or points.dtype.char not in "fd":
        return distances_reference(points, near, far)
    squared, valid = np.empty(len(points), dtype=points.dtype), np.empty(len(points), dtype=bool)
    kernels.compiled.square_distances(np.ascontiguousarray(points), near * near, far * far, squared, valid)
    return squared, valid


def distances_reference(points: NDArray, near: float, far: float) -> tuple[NDArray, NDArray[np.bool_]]:
    """`distances` in NumPy."""
    with np.errstate(over="ignore", invalid="ignore"):
        x, y, z = np.ascontiguousarray(points.T)
        squared = x * x + y * y + z * z
        return squared, (squared >= near * near) & (squared <= far * far)


def _all_beyond(squared: NDArray) -> str:
    """What to say where all points are out of range. squared: (N,) their distances', of those measured."""
    if not len(squared):
        return ""
    nearest, farthest = math.sqrt(squared.min()), math.ceil(2 * math.sqrt(squared.max())) / 2
    said = f"; the nearest is {nearest:.4g} m away"
    if farthest > FARTHEST:
        return said
    return said + f": say depth_range=[0,{farthest:g}], on the command line '+segmenter.depth_range=[0,{farthest:g}]'"


def _up_setting(plane: FloatArray) -> str:
    """What says that up is along a plane's normal."""
    if plane[2] > ALONG_Z:
        return "frame=world"
    return f"up=[{','.join(f'{value:.2f}' for value in plane[:3] + 0.0)}]"


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
    # One row or one column is a list of points and no image.
    shape = (points.shape[0], points.shape[1]) if points.ndim == 3 and min(points.shape[:2]) > 1 else None
    return points.reshape(-1, 3), shape
