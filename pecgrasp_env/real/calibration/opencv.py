"""OpenCV, with what calibration needs of it: its 5.0 for Python has the board, but not the hand-eye methods."""

from __future__ import annotations

from typing import Any

from pecgrasp_env.real.errors import MissingExtra, library


def opencv() -> Any:
    """The module cv2. Raises MissingExtra where it is missing or lacks what is needed."""
    cv2: Any = library("cv2", "calibrate")
    for part in ("aruco", "calibrateHandEye"):
        if not hasattr(cv2, part):
            raise MissingExtra(f"OpenCV {cv2.__version__} has no cv2.{part}: pip install 'pecgrasp[calibrate]'")
    return cv2
