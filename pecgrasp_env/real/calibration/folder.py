"""From a folder of views to the camera's file, the figures, and the page that shows them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.calibrate import Calibration, calibrate
from pecgrasp_env.real.calibration.hand_eye import Estimate
from pecgrasp_env.real.calibration.page import calibration_page
from pecgrasp_env.real.calibration.recorded_views import read_views
from pecgrasp_env.robot.camera_mount import write_mount


def calibrate_folder(folder: Path, board: Board, parent: str, output: Path) -> Calibration:
    """Reads a folder of views (`recorded_views`) and writes `T_tool0_camera.yaml` or `T_base_camera.yaml`,
    results.json and calibration.html into `output`. Raises CalibrationError.
    """
    result = calibrate(*read_views(folder), board, parent)
    output.mkdir(parents=True, exist_ok=True)
    best = result.hand_eye.best
    _, shift, turn = best.rms
    about = {
        "views": len(result.used),
        "left_one_out_mm": round(1e3 * shift, 3),
        "left_one_out_degrees": round(float(np.degrees(turn)), 3),
    }
    write_mount(output / f"T_{parent}_camera.yaml", parent, best.T_mount_camera, about)
    text = json.dumps(as_results(result), indent=1, allow_nan=False) + "\n"
    (output / "results.json").write_text(text, encoding="utf-8")
    (output / "calibration.html").write_text(calibration_page(result, folder.name), encoding="utf-8")
    return result


def as_results(result: Calibration) -> dict[str, Any]:
    """Plain values: millimetres and degrees where a name says so, else metres."""
    best, uncertainty = result.hand_eye.best, result.hand_eye.uncertainty
    rows = zip(result.used, best.pixels, best.shift, best.turn, strict=True)
    return {
        "parent": result.parent,
        f"T_{result.parent}_camera": best.T_mount_camera.tolist(),
        "uncertainty_mm": (1e3 * uncertainty[:3]).tolist(),
        "uncertainty_degrees": np.degrees(uncertainty[3:]).tolist(),
        "methods": [method_results(each) for each in result.hand_eye.methods],
        "failed_methods": result.hand_eye.failed,
        "board_scale": result.hand_eye.scale,
        "spread_degrees": np.degrees(result.variety.spread).tolist(),
        "views": [
            {
                "name": view.name,
                "corners": len(corners.numbers),
                "pixels": float(pixels),
                "left_one_out_mm": 1e3 * float(shift),
                "left_one_out_degrees": float(np.degrees(turn)),
            }
            for (view, corners), pixels, shift, turn in rows
        ],
        "left_out": [{"name": name, "why": why} for name, why in result.left_out],
        "to_mend": result.words,
    }


def method_results(estimate: Estimate) -> dict[str, Any]:
    pixels, shift, turn = estimate.rms
    return {
        "method": estimate.method,
        "pixels": pixels,
        "left_one_out_mm": 1e3 * shift,
        "left_one_out_degrees": float(np.degrees(turn)),
        "T": estimate.T_mount_camera.tolist(),
    }
