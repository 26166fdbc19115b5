"""The page of a calibration: how far the methods and the views agree, and each picture with the board's corners."""

from __future__ import annotations

import base64
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from grasping.viewer.html import page, templates
from pecgrasp_env.real.calibration.calibrate import Calibration
from pecgrasp_env.real.calibration.corners import Corners, project
from pecgrasp_env.real.calibration.opencv import opencv

_SEEN, _EXPECTED = (80, 200, 60), (40, 60, 235)  # BGR
_FINE = 4  # bits of a pixel's fraction, of OpenCV's drawing


class Tile(NamedTuple):
    figure: str
    lines: tuple[str, ...]


def calibration_page(result: Calibration, title: str) -> str:
    """A self-contained HTML document."""
    best, uncertainty = result.hand_eye.best, result.hand_eye.uncertainty
    pixels, shift, turn = best.rms
    tiles = [
        Tile(
            f"{1e3 * shift:.2f} mm", (f"and {np.degrees(turn):.2f}° between each view", "and what the others say of it")
        ),
        Tile(f"{pixels:.2f} px", ("RMS of all corners", f"in {len(result.used)} views")),
        Tile(
            f"± {1e3 * np.linalg.norm(uncertainty[:3]):.2f} mm",
            (
                f"and {np.degrees(np.linalg.norm(uncertainty[3:])):.2f}°: standard error",
                "of the camera's place and turn",
            ),
        ),
        Tile(
            " · ".join(f"{np.degrees(each):.0f}°" for each in result.variety.spread),
            (f"turns of {result.parent} about its", "three main axes, RMS"),
        ),
    ]
    methods = [
        (
            each.method,
            f"{each.rms[0]:.3f}",
            f"{1e3 * each.rms[1]:.2f}",
            f"{np.degrees(each.rms[2]):.3f}",
            *_place(each.T_mount_camera),
        )
        for each in result.hand_eye.methods
    ]
    methods += [(name, "found nothing", "", "", "", "") for name in result.hand_eye.failed]
    views = [
        (view.name, str(len(corners.numbers)), f"{pixels:.2f}", f"{1e3 * shift:.2f}", f"{np.degrees(turn):.2f}")
        for (view, corners), pixels, shift, turn in zip(result.used, best.pixels, best.shift, best.turn, strict=True)
    ]
    pictures = []
    for view, corners in result.used:
        mount_world = np.linalg.inv(view.T_base_tool0) if result.parent == "tool0" else view.T_base_tool0
        T = np.linalg.inv(best.T_mount_camera) @ mount_world @ best.T_world_board
        expected = project(corners.board @ T[:3, :3].T + T[:3, 3], result.intrinsics)
        pictures.append((view.name, _jpeg(_marked(view.image, corners, expected))))
    sheets = (files("pecgrasp_env.common") / "report.css", files(__package__) / "templates" / "calibration.css")
    style = "".join(sheet.read_text(encoding="utf-8") for sheet in sheets)
    template = templates("pecgrasp_env.real.calibration", "pecgrasp_env.common").get_template("calibration.html")
    values = {
        "title": f"Where the camera is: {title}",
        "parent": result.parent,
        "T": [[f"{value + 0.0:.5f}" for value in row] for row in best.T_mount_camera],
        "tiles": tiles,
        "methods": methods,
        "views": views,
        "left_out": result.left_out,
        "words": result.words,
        "pictures": pictures,
    }
    return page(values["title"], template.render(**values), style=style)  # type: ignore[arg-type]


def _place(T: np.ndarray) -> tuple[str, str]:
    """Millimetres, and degrees of the rotation vector."""
    vector = opencv().Rodrigues(T[:3, :3])[0].reshape(3)
    return (
        ", ".join(f"{value:.2f}" for value in 1e3 * T[:3, 3]),
        ", ".join(f"{value:.2f}" for value in np.degrees(vector)),
    )


def _marked(image: np.ndarray, corners: Corners, expected: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: a ring round each corner that was found, a dot where it should be."""
    cv2 = opencv()
    drawn = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for (u, v), (u_expected, v_expected) in zip(corners.pixels - 0.5, expected - 0.5, strict=True):
        at, there = ([round(x * 2**_FINE) for x in pair] for pair in ((u, v), (u_expected, v_expected)))
        cv2.circle(drawn, at, 6 << _FINE, _SEEN, 1, cv2.LINE_AA, _FINE)
        cv2.circle(drawn, there, 1 << _FINE, _EXPECTED, -1, cv2.LINE_AA, _FINE)
    return np.asarray(drawn)


def _jpeg(image: np.ndarray) -> str:
    cv2 = opencv()
    content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode()}"
