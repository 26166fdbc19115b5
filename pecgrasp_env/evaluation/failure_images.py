"""Images of an episode that failed: what the camera saw with the grasp that was planned, the try, and the end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image, ImageDraw

from grasping import ROBOTIQ_2F_140, Grasp
from pec.common.atomic_files import replacing
from pecgrasp_env.common.depth_image import depth_picture
from pecgrasp_env.evaluation.episode import Policy
from pecgrasp_env.evaluation.recording_policy import Sight, Watched
from pecgrasp_env.policy.observation import RobotObservation

# In the order in which they were taken.
KINDS = ("camera", "try", "end")
_EYE, _AIM, _FOV = (0.98, 0.48, 0.52), (0.46, 0.0, 0.10), 0.85  # m, world frame; rad: the objects and the hand
_WIDTH, _HEIGHT = 424, 318  # pixels
_QUALITY = 60
_SHOWN = 0.5  # of the width and height of the wrist camera's image, about the grasp
_BELOW = 60  # pixels
_ALIKE = 1.0  # of 255, mean difference of two images of which one is enough
_GRASP, _CHOSEN = (255, 70, 60), (255, 255, 255)
_TONES = ((240, 150, 200), (130, 200, 255), (255, 190, 110), (190, 160, 255))
_HAS_CLOSED = "lifting"  # what the policy is doing from the moment on in which the hand has closed
_BEHIND_M = 0.06  # of the hand that is drawn behind the pads


def camera() -> dict[str, Any]:
    """The environment's render camera, to make it with: ``human_render_camera_configs``."""
    from mani_skill.utils import sapien_utils

    return {"pose": sapien_utils.look_at(_EYE, _AIM), "width": _WIDTH, "height": _HEIGHT, "fov": _FOV}


class FailureImages:
    """Looks on while `policy` acts in `env`; images are rendered of each try, and kept by `save`.

    A try is best judged where the hand has closed and not yet lifted; one that fails before, where it does.
    env: with a render camera.
    """

    def __init__(self, env: gym.Env, policy: Policy) -> None:
        self.policy = Watched(policy)
        self._env = env
        self._failures = 0
        self._doing = ""
        self._closed = False  # in the present try
        self._try: np.ndarray | None = None

    def on_step(self, env: gym.Env) -> None:
        log = self.policy.log
        if log.doing != self._doing and log.doing == _HAS_CLOSED:
            self._closed, self._try = True, _render(env)
        if len(log.failures) > self._failures:
            if not self._closed:
                self._try = _render(env)
            self._failures, self._closed = len(log.failures), False
        self._doing = log.doing

    def save(self, folder: Path, seed: int) -> None:
        """Write FOLDER/SEED.KIND.webp of each kind that there is; "end" always, "try" where it shows something else."""
        folder.mkdir(parents=True, exist_ok=True)
        end = _render(self._env)
        images = {"end": end}
        if self._try is not None and np.abs(self._try.astype(float) - end).mean() > _ALIKE:
            images["try"] = self._try
        if self.policy.sight is not None:
            images["camera"] = observed_image(self.policy.sight)
        for kind, image in images.items():
            with replacing(folder / f"{seed}.{kind}.webp") as temporary:
                Image.fromarray(image).save(temporary, "WEBP", quality=_QUALITY)


def observed_image(sight: Sight) -> np.ndarray:
    """(h, 424, 3) uint8: the depth frame in colours, each segmented object in its own tone, with its likeliest class.

    Where one was chosen, only the part about it, with the best grasp as pads and hand in red.
    """
    observation = sight.observation
    depth = observation.frame.depth
    height, width = depth.shape
    places = [np.column_stack(_pixels(observation, seen.points)) for seen in sight.objects]
    tinted = np.full((height, width), -1)
    for k, place in enumerate(places):
        column, row = place[((place >= 0) & (place < (width, height))).all(axis=1)].astype(int).T
        tinted[row, column] = k
    left, top, share = 0, 0, 1.0
    if sight.chosen is not None:
        share, size = _SHOWN, np.array([width, height])
        corner = places[sight.chosen].mean(axis=0) - share * size / 2
        left, top = np.clip(corner, 0, (1 - share) * size).astype(int)
    part = slice(top, top + round(share * height)), slice(left, left + round(share * width))
    picture, tinted = depth_picture(depth[part]), tinted[part]
    for k in range(len(places)):
        tone = _CHOSEN if k == sight.chosen else _TONES[k % len(_TONES)]
        picture[tinted == k] = (0.5 * picture[tinted == k] + 0.5 * np.array(tone)).astype(np.uint8)
    scale = _WIDTH / picture.shape[1]
    image = Image.fromarray(picture).resize((_WIDTH, round(scale * picture.shape[0])))
    draw = ImageDraw.Draw(image)
    if sight.plan is not None and sight.plan.best is not None:
        for line in _outlines(sight.plan.best):
            xy = (np.column_stack(_pixels(observation, line)) - (left, top)) * scale
            draw.line([(float(x), float(y)) for x, y in xy], _GRASP, 2)
    for k, (seen, place) in enumerate(zip(sight.objects, places, strict=True)):
        if seen.evidence:
            x, y = (place.mean(axis=0) - (left, top)) * scale
            y += _BELOW if k == sight.chosen else 0  # off the grasp
            label, probability = max(seen.probabilities().items(), key=lambda item: item[1])
            words = f"{label.replace('_', ' ')} {100 * probability:.0f} %"
            draw.text((x, y), words, "white", anchor="mm", stroke_width=2, stroke_fill="black")
    return np.asarray(image)


def _outlines(grasp: Grasp) -> Iterator[np.ndarray]:
    """Polylines (K, 3) in the cloud's frame, m: the pads' faces, the hand behind them, the line on which they close."""
    hand = ROBOTIQ_2F_140
    x, y, z = grasp.width / 2, hand.finger_width / 2, hand.pad_length / 2
    lines = [[(side * x, u * y, v * z) for u, v in _SQUARE] for side in (-1, 1)]
    lines.append([(-x, 0, -z), (-x, 0, -z - _BEHIND_M), (x, 0, -z - _BEHIND_M), (x, 0, -z)])
    lines.append([(0, 0, -z - _BEHIND_M), (0, 0, -z - 2 * _BEHIND_M)])
    lines.append([(-x, 0, 0), (x, 0, 0)])
    for line in lines:
        yield np.array(line) @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]


_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))


def _pixels(observation: RobotObservation, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (n,) of points (n, 3) of the base frame, which may lie outside of the frame."""
    T = np.linalg.inv(observation.T_base_camera)
    x, y, z = (points @ T[:3, :3].T + T[:3, 3]).T
    K, z = observation.frame.intrinsics, np.maximum(z, 1e-3)
    return K.fx * x / z + K.cx, K.fy * y / z + K.cy


def _render(env: Any) -> np.ndarray:
    return np.asarray(env.render()[0].cpu(), np.uint8)
