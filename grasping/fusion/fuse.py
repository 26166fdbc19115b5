"""One cloud of an object from several views: table off, aligned by ICP, merged by a voxel grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.errors import CloudError, ConfigError, require_between
from grasping.fusion.icp import Alignment, Surface, align, moved
from grasping.geometry.voxel_grid import cube_means, cubes
from grasping.segmentation.frame import Frame
from grasping.segmentation.planes import Plane, refine
from grasping.segmentation.table_plane import LEAST_SHARE, SAMPLED, find_table
from grasping.validation import FARTHEST, LARGEST_OBJECT, plane_equation

FloatArray = NDArray[np.float64]

TABLE_BAND = (0.003, 0.010)  # m, least and greatest: three times the table's residual
TABLE_NEAR = 0.03  # m from where the caller says that the table is, and
MOST_TILT = 0.1  # rad against it
LEAST_POINTS = 50  # of a view on the voxel grid
CROWD, LONELY = 8, 3.0  # a point is stray where its 8th neighbour is three times farther than that of most
MOST_POINTS = 20_000  # that are aligned; larger views are thinned
SEARCH = 3.0  # times the distance, for a view that does not fit at once
LEAST_OVERLAP = 0.3  # share of a view's points that have a partner
WORST_FIT = 0.3  # of the correspondence distance: what does not fit is off by half of it
SLID = 0.005  # m along a motion that the surfaces leave open
ROUNDS = 2  # in which each view is aligned once more, with all the others


@dataclass(frozen=True)
class FusedView:
    """What became of one view.

    T_common_view: (4, 4) as aligned; the rough pose where the view is left out. reason: why it is left out, else None.
    overlap: share of its points with a partner in the other views; rmse: their distance to the partners' tangent
    planes, m. shift, turn: what ICP added to the rough pose, m at the view's centre and rad. free: in words, the
    motions that the surfaces leave open, in which the view keeps its rough pose.
    """

    T_common_view: FloatArray
    reason: str | None
    overlap: float
    rmse: float
    shift: float
    turn: float
    free: list[str]


@dataclass(frozen=True)
class Fused:
    """points: (M, 3) merged, without the table, in the frame that the poses lead to, or the first view's.

    views: one entry a view.
    """

    points: FloatArray
    views: list[FusedView]

    @property
    def kept(self) -> list[int]:
        """Numbers of the views that are in the merged cloud."""
        return [number for number, view in enumerate(self.views) if view.reason is None]

    def summary(self) -> str:
        """What was left out or left open, in a sentence."""
        parts = []
        for number, view in enumerate(self.views):
            if view.reason is not None:
                parts.append(f"view {number} left out: {view.reason}")
            elif view.free:
                parts.append(f"view {number} keeps its rough pose in {' and in '.join(view.free)}")
        return "; ".join(parts) if parts else f"all {len(self.views)} views fit"


def fuse(
    views: Sequence[ArrayLike],
    *,
    poses: Sequence[ArrayLike] | None = None,
    table: ArrayLike | str | None = None,
    voxel: float = 0.002,
    distance: float = 0.01,
    iterations: int = 100,
    max_shift: float = 0.05,
    max_turn: float = 0.35,
) -> Fused:
    """Merge clouds of one object, or of the things on one table, seen from several places.

    Each view is aligned with those before it, a view that does not fit yet is tried again after the others, and at last
    each once more with all the others. The first view (with enough points) stays where it is. A view that does not
    overlap, does not fit or would move too far from its rough pose is left out, and said why; nothing is merged that
    is not aligned. Where the surfaces leave a motion open, as a cylinder does a turn about its axis, the view keeps its
    rough pose in it, which `FusedView.free` says: there the merged cloud is as good as the pose that came in.

    views: clouds (N, 3) or organised frames (H, W, 3), m; NaN and (0, 0, 0) are invalid. poses: T_common_camera (4, 4)
    of each, as a robot's kinematics give it: a view is then in its camera's frame, seen from the origin. Without poses
    the views are in one frame already, but for a few centimetres and degrees. table: its plane (4,) in the common
    frame, which is measured anew in each view; or "find", where every view shows it; or None, where the clouds hold
    none. voxel: edge of the grid on which the merged cloud has a point, m. distance: between points that may be one, m,
    and iterations of ICP: the dissertation's 0.01 and 100. max_shift, max_turn: from the rough pose, m and rad.

    Raises CloudError for a view that is no cloud, has no valid point or spans over 2 m without the table, ConfigError
    for poses that are not rigid and parameters that make no sense.
    """
    for name, value, least, most in (
        ("voxel", voxel, 5e-4, 0.05),
        ("distance", distance, 0.001, 0.1),
        ("iterations", iterations, 1, 10_000),
        ("max_shift", max_shift, 0.0, 1.0),
        ("max_turn", max_turn, 0.0, np.pi),
    ):
        require_between(name, value, least, most)
    if not len(views):
        raise ConfigError("views: there is none")
    if isinstance(table, str) and table != "find":
        raise ConfigError(f"table = {table!r} must be a plane (4,), 'find' or None")
    plane = table if table is None or isinstance(table, str) else plane_equation(table)
    rough = [np.eye(4)] * len(views) if poses is None else _rigid(poses, len(views))
    eye = None if poses is None else np.zeros(3)
    prepared = [
        _prepare(f"views[{number}]", view, T, plane, voxel, eye)
        for number, (view, T) in enumerate(zip(views, rough, strict=True))
    ]
    joining = _Joining(prepared, distance, int(iterations), max_shift, max_turn)
    joining.run()
    merged = [moved(joining.found[number], prepared[number].points) for number in sorted(joining.found)]
    points = np.concatenate(merged) if merged else np.empty((0, 3))
    grid = cube_means(points, cubes(points, voxel)) if merged else points
    return Fused(grid, [joining.report(number) for number in range(len(views))])


def _stray(points: FloatArray) -> NDArray[np.bool_]:
    """(N,) points of a grid whose neighbours lie much farther away than those of most: noise in the air."""
    if len(points) <= CROWD:
        return np.zeros(len(points), dtype=bool)
    away = cKDTree(points).query(points, k=CROWD + 1)[0][:, CROWD]
    return np.asarray(away > LONELY * np.median(away))


@dataclass(frozen=True)
class _View:
    """points: (N, 3) without the table, camera frame. surface: None where `reason` says why it cannot be aligned."""

    points: FloatArray
    rough: FloatArray
    surface: Surface | None
    reason: str | None


def _prepare(
    name: str, view: ArrayLike, T: FloatArray, plane: FloatArray | str | None, voxel: float, eye: FloatArray | None
) -> _View:
    try:
        frame = Frame(view, (0.0, FARTHEST))
    except CloudError as error:
        raise CloudError(f"{name}: {error}") from error
    points = frame.points[frame.valid].astype(np.float64)
    if plane is not None:
        found = _table_of(frame, plane, T)
        if isinstance(found, str):
            return _View(points, T, None, f"its table was not found: {found}")
        points = points[found.distances(points) > found.band]
    if len(points) and (span := float(np.ptp(points, axis=0).max())) > LARGEST_OBJECT:
        raise CloudError(
            f"{name}: spans {span:.6g} m, more than {LARGEST_OBJECT} m; are these millimetres, or is it to be cropped"
            " to what stands on the table?"
        )
    if not len(points):
        return _View(points, T, None, "nothing is left without the table")
    numbers = cubes(points, voxel)
    while numbers.max() >= MOST_POINTS:
        voxel *= 1.5
        numbers = cubes(points, voxel)
    thin = cube_means(points, numbers)
    stray = _stray(thin)
    points, thin = points[~stray[numbers]], thin[~stray]
    if len(thin) < LEAST_POINTS:
        return _View(points, T, None, f"only {len(thin)} points on the voxel grid, {LEAST_POINTS} are needed")
    return _View(points, T, Surface.of(thin, eye), None)


def _table_of(frame: Frame, plane: FloatArray | str, T: FloatArray) -> Plane | str:
    """The table in a view's own frame, measured in that view where it shows enough of it."""
    sample = frame.sample(SAMPLED, np.random.default_rng(0))
    if isinstance(plane, str):
        return find_table(sample, None, np.random.default_rng(0), coarse=TABLE_BAND[1], band=TABLE_BAND).table
    own = np.append(plane[:3] @ T[:3, :3], plane[:3] @ T[:3, 3] + plane[3])
    measured = refine(sample, own, TABLE_NEAR, TABLE_BAND)
    members = np.abs(measured.distances(sample)) <= measured.band
    tilt = float(measured.equation[:3] @ own[:3])
    if members.mean() < LEAST_SHARE or tilt < np.cos(MOST_TILT):
        return Plane(own, TABLE_BAND[1], TABLE_BAND[1])
    return measured


def _rigid(poses: Sequence[ArrayLike], count: int) -> list[FloatArray]:
    """The poses, checked. Raises ConfigError where there are not `count` or one is no rigid motion."""
    if len(poses) != count:
        raise ConfigError(f"poses: {len(poses)} of them for {count} views")
    checked = []
    for number, pose in enumerate(poses):
        try:
            T = np.asarray(pose, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ConfigError(f"poses[{number}] = {pose!r} is not a matrix (4, 4)") from error
        if T.shape != (4, 4) or not np.abs(T).max() <= FARTHEST:
            raise ConfigError(f"poses[{number}] = {pose!r} is not a finite matrix (4, 4)")
        turn = T[:3, :3]
        rigid = np.abs(turn @ turn.T - np.eye(3)).max() < 1e-3 and np.linalg.det(turn) > 0
        if not rigid or np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-6:
            raise ConfigError(f"poses[{number}] = {pose!r} is not a rigid motion")
        checked.append(T)
    return checked


class _Joining:
    """Views that find their places one after the other. found: T_common_view of those that have one."""

    def __init__(self, views: list[_View], distance: float, iterations: int, max_shift: float, max_turn: float) -> None:
        self.views = views
        self.surfaces = {number: view.surface for number, view in enumerate(views) if view.surface is not None}
        self.distance = distance
        self.iterations = iterations
        self.max_shift = max_shift
        self.max_turn = max_turn
        self.found: dict[int, FloatArray] = {}
        self.fits: dict[int, Alignment] = {}
        self.reasons = {number: view.reason for number, view in enumerate(views) if view.reason is not None}

    def run(self) -> None:
        waiting = list(self.surfaces)
        if waiting:
            first = waiting.pop(0)
            self.found[first] = self.views[first].rough
        placed = waiting
        while placed:
            placed = [number for number in waiting if self.place(number, self.views[number].rough)]
            waiting = [number for number in waiting if number not in placed]
        for _ in range(ROUNDS if len(self.found) > 2 else 0):
            for number in list(self.found)[1:]:
                self.place(number, self.found[number])

    def place(self, number: int, start: FloatArray) -> bool:
        """Align a view with all others that have a place; False where it cannot stay there, with the reason noted."""
        others = [self.surfaces[other].moved(T) for other, T in self.found.items() if other != number]
        target = Surface.joined(others)
        for search in (self.distance, SEARCH * self.distance):
            fit = align(
                self.surfaces[number],
                target,
                start,
                distance=self.distance,
                iterations=self.iterations,
                search=search,
            )
            why = self.refusal(fit, self.views[number].rough)
            if why is None:
                break
        if why is None:
            self.found[number], self.fits[number] = fit.T_target_source, fit
            self.reasons.pop(number, None)
        elif number not in self.found:
            self.fits[number], self.reasons[number] = fit, why
        return why is None

    def refusal(self, fit: Alignment, rough: FloatArray) -> str | None:
        shift, turn, slid = fit.departure(rough)
        if fit.overlap < LEAST_OVERLAP:
            near = f"within {self.distance * 1e3:g} mm of the other views"
            return f"only {100 * fit.overlap:.0f} % of its points lie {near}, {100 * LEAST_OVERLAP:.0f} are needed"
        if fit.rmse > WORST_FIT * self.distance:
            return f"its points lie {fit.rmse * 1e3:.1f} mm off the other views' surface"
        if shift > self.max_shift or turn > self.max_turn:
            return (
                f"it fits only {shift * 100:.1f} cm and {np.degrees(turn):.0f}° from its rough pose, more than"
                f" {self.max_shift * 100:g} cm or {np.degrees(self.max_turn):.0f}°"
            )
        if slid > SLID:
            return f"it slid by {slid * 1e3:.0f} mm in {' and in '.join(fit.free_motions())}, which nothing fixes"
        return None

    def report(self, number: int) -> FusedView:
        view, fit = self.views[number], self.fits.get(number)
        T, reason = self.found.get(number, view.rough), self.reasons.get(number)
        if fit is None:  # the first one, or one that could not be aligned
            return FusedView(T, reason, 0.0, 0.0, 0.0, 0.0, [])
        shift, turn, _ = fit.departure(view.rough)
        return FusedView(T, reason, fit.overlap, fit.rmse, shift, turn, fit.free_motions())
