"""Labelled clouds with no human in the loop: put an object before the camera, take a frame, cut out, label, save."""

from pecgrasp_env.capture.config import CaptureConfig, CaptureError, ObjectsConfig, TabletopConfig
from pecgrasp_env.capture.data_card import write_card
from pecgrasp_env.capture.generate import Generation, generate
from pecgrasp_env.capture.summary import summarise

__all__ = [
    "CaptureConfig",
    "CaptureError",
    "Generation",
    "ObjectsConfig",
    "TabletopConfig",
    "generate",
    "summarise",
    "write_card",
]
