"""A folder of images of the board with the arm's pose at each: what `pecgrasp calibrate` reads, and live views leave.

FOLDER/camera.yaml   width, height, fx, fy, cx, cy: pixels; cx, cy from the image's corner
FOLDER/poses.csv     a line an image: image,x,y,z,qw,qx,qy,qz   T_base_tool0, m and a quaternion
                     or               image,x,y,z,rx,ry,rz      the same with a rotation vector, rad
                     or               image,q1,q2,q3,q4,q5,q6   joint angles of a UR5, rad
FOLDER/*.png         (or .jpg, .tif), undistorted, grey or colour; for `check` depth images, uint16 millimetres
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from grasping.cloud_files.depth_frame import checked_intrinsics
from grasping.errors import CloudError
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.opencv import opencv
from pecgrasp_env.robot.kinematics import forward_kinematics
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
_QUATERNION = ("x", "y", "z", "qw", "qx", "qy", "qz")
_VECTOR = ("x", "y", "z", "rx", "ry", "rz")
_JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6")
_FARTHEST_M = 3.0


@dataclass(frozen=True)
class RecordedView:
    """name: of the image's file. image: (H, W) uint8, or float32 m of a depth image. T_base_tool0: (4, 4)."""

    name: str
    image: np.ndarray
    T_base_tool0: np.ndarray


def read_views(folder: Path) -> tuple[CameraIntrinsics, list[RecordedView]]:
    """Images uint8. Raises CalibrationError that names the file and what is wrong in it."""
    return _read(folder, np.uint8)


def read_depth_views(folder: Path) -> tuple[CameraIntrinsics, list[RecordedView]]:
    """Images of depth, float32 m, 0 for none. Raises CalibrationError that names the file and what is wrong in it."""
    return _read(folder, np.uint16)


def _read(folder: Path, kind: type[np.uint8] | type[np.uint16]) -> tuple[CameraIntrinsics, list[RecordedView]]:
    for name in ("camera.yaml", "poses.csv"):
        if not (folder / name).is_file():
            raise CalibrationError(
                f"{folder}: there is no {name}; a folder of views has camera.yaml, poses.csv and images"
            )
    intrinsics = read_intrinsics(folder / "camera.yaml")
    cv2 = opencv()
    views = []
    for name, T in _poses(folder / "poses.csv"):
        flag = cv2.IMREAD_GRAYSCALE if kind is np.uint8 else cv2.IMREAD_UNCHANGED
        image = cv2.imread(str(folder / name), flag) if (folder / name).is_file() else None
        if image is None:
            raise CalibrationError(f"{folder / 'poses.csv'}: {name} is no image that can be read")
        if image.dtype != kind or image.ndim != 2:
            raise CalibrationError(
                f"{folder / name}: {image.dtype} of shape {image.shape}, expected {kind.__name__} (H, W)"
            )
        if image.shape != (intrinsics.height, intrinsics.width):
            raise CalibrationError(
                f"{folder / name}: {image.shape[1]} × {image.shape[0]} pixels, camera.yaml says {intrinsics.width} × "
                f"{intrinsics.height}: give the intrinsics of these images"
            )
        views.append(RecordedView(name, image if kind is np.uint8 else image * np.float32(1e-3), T))
    return intrinsics, views


def write_views(folder: Path, intrinsics: CameraIntrinsics, views: Sequence[RecordedView]) -> None:
    """What `read_views` and `read_depth_views` read."""
    folder.mkdir(parents=True, exist_ok=True)
    write_intrinsics(folder / "camera.yaml", intrinsics)
    with (folder / "poses.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("image", *_QUATERNION))
        for view in views:
            turn = Rotation.from_matrix(view.T_base_tool0[:3, :3]).as_quat()[[3, 0, 1, 2]]
            rows.writerow((view.name, *(f"{value:.9g}" for value in (*view.T_base_tool0[:3, 3], *turn))))
            millimetres = view.image.dtype.kind == "f"
            stored = np.rint(1e3 * view.image).astype(np.uint16) if millimetres else view.image
            opencv().imwrite(str(folder / view.name), stored)


def read_intrinsics(path: Path) -> CameraIntrinsics:
    """Raises CalibrationError."""
    try:
        stored = yaml.safe_load(path.read_text(encoding="utf-8"))
        given = {name: float(stored[name]) for name in _INTRINSICS}
    except (OSError, UnicodeDecodeError, yaml.YAMLError, TypeError, KeyError, ValueError) as error:
        raise CalibrationError(f"{path}: {error}: numbers {', '.join(_INTRINSICS)} are wanted") from error
    size, lens = (int(given[name]) for name in _INTRINSICS[:2]), (given[name] for name in _INTRINSICS[2:])
    intrinsics = CameraIntrinsics(*size, *lens)
    try:
        checked_intrinsics(intrinsics.matrix, (intrinsics.height, intrinsics.width), "fx, fy, cx, cy")
    except CloudError as error:
        raise CalibrationError(f"{path}: {error}") from error
    return intrinsics


def write_intrinsics(path: Path, intrinsics: CameraIntrinsics) -> None:
    """What `read_intrinsics` reads."""
    path.write_text("".join(f"{name}: {getattr(intrinsics, name)}\n" for name in _INTRINSICS))


def _poses(path: Path) -> list[tuple[str, np.ndarray]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.DictReader(file, skipinitialspace=True)
        columns = [name.strip() for name in rows.fieldnames or ()]
        form = next((form for form in (_QUATERNION, _VECTOR, _JOINTS) if {"image", *form} <= set(columns)), None)
        if form is None:
            ways = " or ".join(",".join(("image", *form)) for form in (_QUATERNION, _VECTOR, _JOINTS))
            raise CalibrationError(f"{path}: columns {', '.join(columns) or 'none'}; expected {ways}")
        found = []
        for line, row in enumerate(rows, start=2):
            try:
                values = np.array([float(row[name]) for name in form])
            except (TypeError, ValueError) as error:
                raise CalibrationError(f"{path}, line {line}: {error}") from error
            try:
                found.append((row["image"].strip(), _pose(form, values)))
            except CalibrationError as error:
                raise CalibrationError(f"{path}, line {line}: {error}") from error
    return found


def _pose(form: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    if not np.isfinite(values).all():
        raise CalibrationError(f"{values.tolist()} is not finite")
    if form == _JOINTS:
        if np.abs(values).max() > 2 * np.pi + 0.1:
            raise CalibrationError(f"joint angles {values.tolist()}: radians are wanted")
        return forward_kinematics(values)
    T = np.eye(4)
    T[:3, 3] = values[:3]
    if np.linalg.norm(values[:3]) > _FARTHEST_M:
        raise CalibrationError(f"tool0 at {values[:3].tolist()}: metres are wanted")
    if form == _VECTOR:
        if np.linalg.norm(values[3:]) > 2 * np.pi + 0.1:
            raise CalibrationError(f"rotation vector {values[3:].tolist()}: radians are wanted")
        T[:3, :3] = Rotation.from_rotvec(values[3:]).as_matrix()
    else:
        if abs(np.linalg.norm(values[3:]) - 1) > 0.01:
            raise CalibrationError(
                f"quaternion {values[3:].tolist()} (w, x, y, z) has length {np.linalg.norm(values[3:]):.3g}"
            )
        T[:3, :3] = Rotation.from_quat(values[[4, 5, 6, 3]]).as_matrix()
    return T
