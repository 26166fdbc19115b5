"""The camera's place from views of a board that does not move: OpenCV's closed forms, and weighted least squares.

One equation serves both ways to mount a camera. For view i, with the camera on the hand, `T_mount_world` is the pose of
the base in tool0, the camera is mounted on tool0 and the board lies in the base frame; with a camera beside the robot
it is the pose of tool0 in the base, the camera is mounted on the base and the board is held by the hand. Then

    T_camera_board(i) = T_mount_camera⁻¹ · T_mount_world(i) · T_world_board,

with two unknown transforms that are the same in all views. The closed forms (Tsai and Lenz 1989, Park and Martin 1994,
Horaud and Dornaika 1995, Andreff 1999, Daniilidis 1999) take each image's board pose and each pose of the arm alike.
The least squares begin at the best of them and weigh the six errors of each view by what is known of them: a board's
pose is uncertain as the noise of its corners makes it, most along the line of sight and in tilt, and an arm is where it
says within `ARM_SHIFT` and `ARM_TURN`. To minimise the distances in pixels instead (Tabb and Ahmad Yousef 2017) takes
the arm's poses as exact: with errors of 0.5 mm and 1 mrad that is three times as wrong as Tsai's method, this is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.calibration.corners import Corners, board_pose, project
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.opencv import opencv
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

METHODS = ("tsai", "park", "horaud", "andreff", "daniilidis")
REFINED = "least squares"
ARM_SHIFT, ARM_TURN = (
    5e-4,
    1e-3,
)  # m, rad: along and about each axis; a UR5 repeats to 0.1 mm and is true to some tenths
_LEAST_NOISE = 0.05  # px
LEAST_VIEWS = 4  # three determine it, a fourth contradicts


@dataclass(frozen=True)
class BoardView:
    """One image. T_mount_world: (4, 4), see the module. corners: what it shows of the board."""

    name: str
    T_mount_world: np.ndarray
    corners: Corners


@dataclass(frozen=True)
class Estimate:
    """One method's answer and how well it holds.

    T_mount_camera, T_world_board: (4, 4). pixels: (n,) RMS distance of each view's corners from where they should be,
    px. shift, turn: (n,) how far the board in each view lies from where all *other* views say it is, at its middle, m
    and rad.
    """

    method: str
    T_mount_camera: np.ndarray
    T_world_board: np.ndarray
    pixels: np.ndarray
    shift: np.ndarray
    turn: np.ndarray

    @property
    def rms(self) -> tuple[float, float, float]:
        """Of all views: px, m, rad."""
        return tuple(float(np.sqrt(np.mean(each**2))) for each in (self.pixels, self.shift, self.turn))  # type: ignore[return-value]


@dataclass(frozen=True)
class HandEye:
    """methods: those that gave an answer, the least squares first. uncertainty: (6,) standard errors of that one's
    place and turn along and about the mount's axes, m and rad, by leaving out each view in turn (jackknife).
    failed: methods that found nothing. scale: how large the board is by the arm's motions, of what it is said to be.
    """

    methods: list[Estimate]
    uncertainty: np.ndarray
    failed: list[str]
    scale: float

    @property
    def best(self) -> Estimate:
        return self.methods[0]


def calibrate_hand_eye(views: Sequence[BoardView], intrinsics: CameraIntrinsics, parent: str = "tool0") -> HandEye:
    """parent: "tool0" or "base", which carries the camera. Raises CalibrationError for too few views."""
    if len(views) < LEAST_VIEWS:
        raise CalibrationError(
            f"{len(views)} views show the board, at least {LEAST_VIEWS} are needed and 20 wanted: take more"
        )
    seen = [board_pose(view.corners, intrinsics) for view in views]
    everything = range(len(views))
    without = [[k for k in everything if k != left_out] for left_out in everything]
    closed: dict[str, Estimate] = {}
    for method in METHODS:
        answers = [_closed_form(method, views, seen, chosen) for chosen in [list(everything), *without]]
        if all(answer is not None for answer in answers):
            closed[method] = _judged(method, views, seen, intrinsics, [each for each in answers if each is not None])
    if not closed:
        raise CalibrationError(
            "no method finds the camera's place: are the poses those of tool0, in the order of the images, in metres "
            "and radians, and turned about more than one axis?"
        )
    start = min(closed.values(), key=lambda each: each.rms[0])
    begin = (start.T_mount_camera, start.T_world_board)
    hand_boards = [begin[0] @ board for board in seen] if parent == "tool0" else [begin[1]] * len(views)
    weights = _weights(views, seen, intrinsics, hand_boards)
    whole = _least_squares(views, seen, weights, begin)
    refined = [whole, *_without_each(views, seen, weights, whole)]
    best = _judged(REFINED, views, seen, intrinsics, refined)
    departures = np.array([_twist(whole[0], X) for X, _ in refined[1:]])
    spread = (len(views) - 1) * np.mean((departures - departures.mean(axis=0)) ** 2, axis=0)
    ordered = sorted(closed.values(), key=lambda each: each.rms[0])
    failed = [name for name in METHODS if name not in closed]
    return HandEye([best, *ordered], np.sqrt(spread), failed, _board_scale(views, seen, weights, whole))


Pair = tuple[np.ndarray, np.ndarray]
"""T_mount_camera and T_world_board."""


def _closed_form(
    method: str, views: Sequence[BoardView], seen: Sequence[np.ndarray], chosen: Sequence[int]
) -> Pair | None:
    """From some of the views; None where the method breaks down on them."""
    cv2 = opencv()
    kind = getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}")
    world_mount = [np.linalg.inv(views[k].T_mount_world) for k in chosen]
    boards = [seen[k] for k in chosen]
    try:
        turn, place = cv2.calibrateHandEye(
            [T[:3, :3] for T in world_mount],
            [T[:3, 3] for T in world_mount],
            [T[:3, :3] for T in boards],
            [T[:3, 3] for T in boards],
            method=kind,
        )
    except cv2.error:
        return None
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = turn, np.asarray(place).reshape(3)
    R = X[:3, :3]
    if not np.isfinite(X).all() or np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
        return None
    X[:3, :3] = Rotation.from_matrix(X[:3, :3]).as_matrix()
    each = np.array([T_world_mount @ X @ board for T_world_mount, board in zip(world_mount, boards, strict=True)])
    Y = np.eye(4)
    Y[:3, :3] = Rotation.from_matrix(each[:, :3, :3]).mean().as_matrix()
    Y[:3, 3] = each[:, :3, 3].mean(axis=0)
    return X, Y


def _weights(
    views: Sequence[BoardView],
    seen: Sequence[np.ndarray],
    intrinsics: CameraIntrinsics,
    T_tool0_board: Sequence[np.ndarray],
) -> np.ndarray:
    """(n, 6, 6) that make of each view's error, a shift and a turn in the board's frame, one of unit covariance.

    T_tool0_board: of each view, since the arm errs where its hand is, whatever the hand carries.
    """
    slopes = [_slopes(view.corners, T, intrinsics) for view, T in zip(views, seen, strict=True)]
    squares, freedom = 0.0, 0
    for view, T in zip(views, seen, strict=True):
        off = _shown(view.corners.board, T, intrinsics) - view.corners.pixels
        squares, freedom = squares + float((off**2).sum()), freedom + off.size - 6
    noise = max(_LEAST_NOISE**2, squares / max(1, freedom))
    arm = np.diag([ARM_SHIFT**2] * 3 + [ARM_TURN**2] * 3)
    weights = []
    for slope, T in zip(slopes, T_tool0_board, strict=True):
        to_board = _adjoint(np.linalg.inv(T))
        covariance = noise * np.linalg.inv(slope.T @ slope) + to_board @ arm @ to_board.T
        weights.append(np.linalg.cholesky(np.linalg.inv(covariance)).T)
    return np.array(weights)


def _slopes(corners: Corners, T_camera_board: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """(2 k, 6): how the pixels go with small motions of the board, in its own frame, 1/m and 1/rad."""
    step = 1e-5
    columns = []
    for axis in np.eye(6) * step:
        ahead, behind = (
            _shown(corners.board, T_camera_board @ _motion(sign * axis), intrinsics) for sign in (1.0, -1.0)
        )
        columns.append((ahead - behind).ravel() / (2 * step))
    return np.array(columns).T


def _adjoint(T_a_b: np.ndarray) -> np.ndarray:
    """(6, 6): a small shift and turn in frame b as those in frame a."""
    R, (x, y, z) = T_a_b[:3, :3], T_a_b[:3, 3]
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = R
    result[:3, 3:] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R
    return result


def _errors(
    views: Sequence[BoardView], seen: Sequence[np.ndarray], weights: np.ndarray, start: Pair
) -> Callable[[np.ndarray], np.ndarray]:
    """The weighted errors (6 n,) as a function of small motions (12,) behind the two transforms."""
    board_camera = np.linalg.inv(np.array(seen))
    mount_world = np.array([view.T_mount_world for view in views])

    def errors(step: np.ndarray) -> np.ndarray:
        X, Y = _stepped(start, step)
        return _weighted(weights, board_camera @ np.linalg.inv(X) @ mount_world @ Y)

    return errors


def _least_squares(views: Sequence[BoardView], seen: Sequence[np.ndarray], weights: np.ndarray, start: Pair) -> Pair:
    off = _errors(views, seen, weights, start)
    return _stepped(start, least_squares(off, np.zeros(12), method="lm", x_scale=np.full(12, 0.01)).x)


def _without_each(
    views: Sequence[BoardView], seen: Sequence[np.ndarray], weights: np.ndarray, whole: Pair
) -> list[Pair]:
    """The least squares without each view in turn, by one Gauss-Newton step from those with all: it is that near."""
    off = _errors(views, seen, weights, whole)
    slopes = np.array([(off(step) - off(-step)) / 2e-5 for step in np.eye(12) * 1e-5]).T
    square = slopes.T @ slopes
    found = []
    for own, error in zip(slopes.reshape(-1, 6, 12), off(np.zeros(12)).reshape(-1, 6), strict=True):
        found.append(_stepped(whole, np.linalg.solve(square - own.T @ own, own.T @ error)))
    return found


def _stepped(pair: Pair, step: np.ndarray) -> Pair:
    return pair[0] @ _motion(step[:6]), pair[1] @ _motion(step[6:])


def _board_scale(views: Sequence[BoardView], seen: Sequence[np.ndarray], weights: np.ndarray, start: Pair) -> float:
    """The same least squares with one more unknown: a board so many times as large is as many times as far away."""
    camera_board = np.array(seen)
    mount_world = np.array([view.T_mount_world for view in views])

    def off(step: np.ndarray) -> np.ndarray:
        X, Y = _stepped(start, step[:12])
        scaled = camera_board.copy()
        scaled[:, :3, 3] *= 1 + step[12]
        return _weighted(weights, np.linalg.inv(scaled) @ np.linalg.inv(X) @ mount_world @ Y)

    return 1 + float(least_squares(off, np.zeros(13), method="lm", x_scale=np.full(13, 0.01)).x[12])


def _weighted(weights: np.ndarray, error: np.ndarray) -> np.ndarray:
    """(6 n,) of motions (n, 4, 4) near the identity."""
    twists = np.concatenate([error[:, :3, 3], Rotation.from_matrix(error[:, :3, :3]).as_rotvec()], axis=1)
    return np.asarray(np.einsum("nij,nj->ni", weights, twists)).ravel()


def _judged(
    method: str,
    views: Sequence[BoardView],
    seen: Sequence[np.ndarray],
    intrinsics: CameraIntrinsics,
    answers: Sequence[Pair],
) -> Estimate:
    """answers: from all views, then without each of them."""
    X, Y = answers[0]
    pixels, shift, turn = np.empty((3, len(views)))
    for k, view in enumerate(views):
        pixels[k] = np.sqrt(np.mean(_distances(view, intrinsics, X, Y) ** 2))
        X_others, Y_others = answers[1 + k]
        expected = np.linalg.inv(X_others) @ view.T_mount_world @ Y_others
        middle = np.append(view.corners.board.mean(axis=0), 1)
        shift[k] = np.linalg.norm((expected - seen[k]) @ middle)
        turn[k] = Rotation.from_matrix(expected[:3, :3].T @ seen[k][:3, :3]).magnitude()
    return Estimate(method, X, Y, pixels, shift, turn)


def _distances(view: BoardView, intrinsics: CameraIntrinsics, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """(k,) px between the corners and where they should be."""
    T = np.linalg.inv(X) @ view.T_mount_world @ Y
    return np.linalg.norm(_shown(view.corners.board, T, intrinsics) - view.corners.pixels, axis=1)


def _shown(board: np.ndarray, T_camera_board: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """(k, 2) pixels of points (k, 3) of the board's frame."""
    return project(board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3], intrinsics)


def _motion(step: np.ndarray) -> np.ndarray:
    """(4, 4) of a shift (3,) and a rotation vector (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(step[3:]).as_matrix(), step[:3]
    return T


def _twist(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(6,) from one transform to the other along and about the outer frame's axes: m, rad."""
    turned = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
    return np.concatenate([after[:3, 3] - before[:3, 3], turned])
