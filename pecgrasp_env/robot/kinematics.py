"""Forward and analytic inverse kinematics of a UR, and where tool0 must be for a grasp. NumPy only.

Frames: `base_link` is the robot's URDF base, turned by π about z against the DH base frame; `tool0` is the flange.
All transforms are (4, 4) float64, metres; joint vectors are (6,) float64, radians, shoulder pan first.
The closed form follows Hawkins, "Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms" (2013), with
arctangents in place of arc cosines where these lose digits. Of a measured arm (`ArmLengths.measured`) it is where
Newton's method begins.
"""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np

from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.arm_lengths import DH, UR5, ArmLengths
from pecgrasp_env.robot.measured_arm import frames, refined

# Camera 0.55 m above (0.5, 0) of the table, looking straight down, image up = away from the robot.
UP = np.array([0.0, 0.0, 1.0])  # of the base frame
HOME = np.array([-0.291338, -1.757533, 1.279259, -1.092523, -np.pi / 2, -0.291338])
HOME.setflags(write=False)
_LEAST_HEIGHT = 0.7  # of a smaller arm's hand over the table, times the UR5's: the camera must not come too near

COUPLER = 0.006  # m, thickness of the plate between the flange and the gripper


def _transform(rotation: list[list[float]], translation: tuple[float, float, float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    matrix.setflags(write=False)
    return matrix


# The gripper's closing axis (its y) lies along tool0's x, so that a grasp frame is tool0 pushed forward along z.
T_TOOL0_GRIPPER = _transform([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], (0, 0, COUPLER))
# Wrist camera (D435), OpenCV optical frame: 120 mm beside the tool's axis on its -y side, looking along tool0's z,
# image right = +x and image down = +y of tool0. The fingers stay just below the image's lower edge at every opening.
T_TOOL0_CAMERA = _transform([[1, 0, 0], [0, 1, 0], [0, 0, 1]], (0, -0.120, 0.055))
# The fixed tool centre point, in grasp axes (x closing, z approach): the pads' centre of the closed gripper.
T_TOOL0_TCP = _transform([[1, 0, 0], [0, 1, 0], [0, 0, 1]], (0, 0, COUPLER + float(linkage.pad_depth(0.0))))

_T_BASE_DH = np.diag([-1.0, -1.0, 1.0, 1.0])
_WRIST_SINGULAR = 1e-7  # |sin q5| below which joints 4 and 6 turn about one line
_REACH_TOLERANCE = 1e-9  # on a cosine: a pose of a stretched arm may round to just outside


def _link_transform(joint: int, angle: float, arm: ArmLengths) -> np.ndarray:
    a, d, alpha = arm.dh[joint]
    c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1.0]])


def forward_kinematics(q: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """T_base_tool0 (4, 4) at joint angles `q` (6,)."""
    q = np.asarray(q, dtype=float)
    if q.shape != (6,):
        raise ValueError(f"q must have shape (6,), got {q.shape}")
    if arm.measured is not None:
        return np.array(frames(q, arm.measured)[-1])
    T = _T_BASE_DH.copy()
    for joint, angle in enumerate(q):
        T = T @ _link_transform(joint, angle, arm)
    return T


@lru_cache(maxsize=16)
def home(arm: ArmLengths = UR5) -> np.ndarray:
    """Joint angles (6,) from which an arm looks down at the middle of the table, as the UR5 does at HOME; nearer to it
    and to the base by its `share`. Raises ValueError for an arm that is too small for that.
    """
    if np.array_equal(arm.dh, DH):
        return HOME
    T = forward_kinematics(HOME)
    T[:3, 3] *= (arm.share, arm.share, max(arm.share, _LEAST_HEIGHT))
    postures = inverse_kinematics(T, arm=arm.with_measured(None))
    if not len(postures):
        raise ValueError(f"an arm with lengths (a, d, alpha) {arm.dh.tolist()} cannot look down at the table")
    q = postures[np.abs((postures - HOME + np.pi) % (2 * np.pi) - np.pi).sum(axis=1).argmin()]
    q.setflags(write=False)
    return q


def inverse_kinematics(T_base_tool0: np.ndarray, q6_if_free: float = 0.0, arm: ArmLengths = UR5) -> np.ndarray:
    """Every posture that puts tool0 at `T_base_tool0` (4, 4): (k, 6) joint angles in (-π, π], k ≤ 8; 0 out of reach.

    Postures that differ by whole turns are listed by `with_turns`. Where the wrist is singular (q5 = 0 or π: only the
    sum or difference of q4 and q6 is determined) q6 is `q6_if_free`, or the nearest value with which the arm reaches.
    Raises ValueError if the input is not a finite (4, 4) matrix.
    """
    T = np.asarray(T_base_tool0, dtype=float)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise ValueError(f"T_base_tool0 must be a finite (4, 4) matrix, got {T!r}")
    if arm.measured is not None:
        near = inverse_kinematics(T, q6_if_free, arm.with_measured(None))
        q = refined(np.repeat(T[None], len(near), axis=0), near, arm.measured)
        return _distinct(list(q[np.isfinite(q).all(axis=1)]))
    T = _T_BASE_DH @ T  # the half turn is its own inverse
    d4, d6 = arm.dh[3, 1], arm.dh[5, 1]
    wrist = T[:3, 3] - d6 * T[:3, 2]
    radius = np.hypot(wrist[0], wrist[1])
    if radius < d4 * (1 - _REACH_TOLERANCE):
        return np.empty((0, 6))
    # The wrist stays at distance d4 from the plane of the arm.
    aim, lean = np.arctan2(wrist[1], wrist[0]), np.arcsin(min(d4 / radius, 1.0))
    postures: list[np.ndarray] = []
    for q1 in (aim + lean, aim + np.pi - lean):
        s1, c1 = np.sin(q1), np.cos(q1)
        normal = np.array([s1, -c1, 0.0])  # axis of joints 2, 3, 4
        across = normal @ T[:3, :3]  # the tool's axes along it: (s5 c6, -s5 s6, c5)
        sin5 = np.hypot(across[0], across[1])
        T_16 = np.linalg.inv(_link_transform(0, q1, arm)) @ T
        for q5 in (np.arctan2(sin5, across[2]), np.arctan2(-sin5, across[2])):
            if sin5 < _WRIST_SINGULAR:
                q6 = _free_joint_6(T_16, q5, q6_if_free, arm)
            else:
                q6 = np.arctan2(-across[1] / np.sin(q5), across[0] / np.sin(q5))
            elbows = _solve_elbow(_before_wrist(T_16, q5, q6, arm), arm)
            postures += [np.array([q1, *elbow, q5, q6]) for elbow in elbows]
    return _distinct(postures)


def _before_wrist(T_16: np.ndarray, q5: float, q6: float, arm: ArmLengths) -> np.ndarray:
    """T_14 from T_16: frame 4 is where joint 4's axis and the wrist's first body are."""
    return T_16 @ np.linalg.inv(_link_transform(4, q5, arm) @ _link_transform(5, q6, arm))


def _free_joint_6(T_16: np.ndarray, q5: float, wish: float, arm: ArmLengths) -> float:
    """The q6 nearest to `wish` with which a singular wrist is within the arm's reach; `wish` where there is none.

    Turning q6 carries frame 4 on a circle of radius d5, of which the arm may reach only a part.
    """
    if _solve_elbow(_before_wrist(T_16, q5, wish, arm), arm):
        return wish
    a2, a3, d5 = arm.dh[1, 0], arm.dh[2, 0], arm.dh[4, 1]
    # The circle's centre is the tool's axis; frame 4 lies at angle `around` on it, and `around` turns with q6.
    centre = T_16[:2, 3]
    distance, bearing = np.hypot(*centre), np.arctan2(centre[1], centre[0])
    around = np.arctan2(*(_before_wrist(T_16, q5, wish, arm)[:2, 3] - centre)[::-1])
    turn = np.sign(np.cos(q5))
    candidates = []
    for reach in ((abs(a2) + abs(a3)) * (1 - 1e-12), abs(a2 - a3) * (1 + 1e-12)):
        cosine = (reach**2 - distance**2 - d5**2) / (2 * distance * d5)
        if abs(cosine) <= 1:
            candidates += [bearing + np.arccos(cosine), bearing - np.arccos(cosine)]
    shifts = [np.angle(np.exp(1j * (candidate - around))) for candidate in candidates]
    return wish - turn * min(shifts, key=abs) if shifts else wish


def _solve_elbow(T_14: np.ndarray, arm: ArmLengths) -> list[tuple[float, float, float]]:
    """(q2, q3, q4) of the planar three-joint chain between frames 1 and 4."""
    x, y, a2, a3 = T_14[0, 3], T_14[1, 3], arm.dh[1, 0], arm.dh[2, 0]
    cos3 = (x * x + y * y - a2**2 - a3**2) / (2 * a2 * a3)
    if abs(cos3) > 1 + _REACH_TOLERANCE:
        return []
    heading = np.arctan2(T_14[1, 0], T_14[0, 0])  # q2 + q3 + q4
    sin3 = np.sqrt(max(0.0, 1 - cos3 * cos3))
    found = []
    for q3 in (np.arctan2(sin3, cos3), np.arctan2(-sin3, cos3)):
        q2 = np.arctan2(y, x) - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
        found.append((q2, q3, heading - q2 - q3))
    return found


def _distinct(postures: list[np.ndarray]) -> np.ndarray:
    """Wrap to (-π, π] and drop doubles, which a singular pose produces."""
    kept: list[np.ndarray] = []
    for q in postures:
        q = -((-q + np.pi) % (2 * np.pi) - np.pi)
        if all(np.abs(np.angle(np.exp(1j * (q - other)))).max() > 1e-9 for other in kept):
            kept.append(q)
    return np.array(kept).reshape(-1, 6)


def with_turns(postures: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """All postures within the joint limits that equal those of `postures` (k, 6) up to whole turns: (m, 6)."""
    rows = []
    for q in np.asarray(postures, dtype=float).reshape(-1, 6):
        choices = [
            [value + turn for turn in (-2 * np.pi, 0.0, 2 * np.pi) if low <= value + turn <= high]
            for value, (low, high) in zip(q, arm.limits, strict=True)
        ]
        rows += list(itertools.product(*choices))
    return np.array(rows).reshape(-1, 6)


def nearest_solution(T_base_tool0: np.ndarray, q_ref: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray | None:
    """The posture within limits that reaches `T_base_tool0` with the least motion (Euclidean, rad) from `q_ref` (6,).

    None where the pose is out of reach. At a wrist singularity joint 6 stays where it is.
    """
    q_ref = np.asarray(q_ref, dtype=float)
    postures = inverse_kinematics(T_base_tool0, q6_if_free=float(q_ref[5]), arm=arm)
    if len(postures) == 0:
        return None
    # Joint by joint the nearest turn is best, and each joint's limits are its own.
    turned = postures[..., None] + np.array([-2 * np.pi, 0.0, 2 * np.pi])
    distance = np.abs(turned - q_ref[:, None])
    distance[(turned < arm.limits[:, :1]) | (turned > arm.limits[:, 1:])] = np.inf
    best = np.take_along_axis(turned, distance.argmin(-1)[..., None], -1)[..., 0]
    return best[np.linalg.norm(best - q_ref, axis=1).argmin()]


def tool0_from_grasp(T_base_grasp: np.ndarray, width: float) -> np.ndarray:
    """T_base_tool0 (4, 4) that has the pads' centre at a grasp's origin when the opening is `width` (m).

    The grasp frame is z approach, x closing, origin midway between the pads. The pads' depth changes by 29 mm over the
    stroke; `width` is therefore the opening at contact. Raises ValueError for a width outside 0 … 0.14.
    """
    if not 0.0 <= width <= linkage.STROKE:
        raise ValueError(f"width must be within 0 … {linkage.STROKE} m, got {width}")
    T = np.array(T_base_grasp, dtype=float)
    T[:3, 3] -= (COUPLER + float(linkage.pad_depth(width))) * T[:3, 2]
    return T
