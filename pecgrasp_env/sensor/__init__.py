"""The simulated depth camera: an Intel RealSense D435, perfect (`ideal`) or with its faults (`d435`)."""

from pecgrasp_env.sensor.d435_noise import SENSOR_MODES, D435Noise, SensorMode, apply_d435, apply_ideal
from pecgrasp_env.sensor.intrinsics import (
    BASELINE,
    D435,
    CameraIntrinsics,
    SensorError,
    deproject,
    deproject_mask,
    intrinsics_of,
    min_depth,
)

__all__ = [
    "BASELINE",
    "D435",
    "SENSOR_MODES",
    "CameraIntrinsics",
    "D435Noise",
    "SensorError",
    "SensorMode",
    "apply_d435",
    "apply_ideal",
    "deproject",
    "deproject_mask",
    "intrinsics_of",
    "min_depth",
]
