"""From a scene's number to its frames: drawn, dropped, looked at, measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
import sapien

from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.capture.rendering.scene_renderer import SceneRenderer
from pecgrasp_env.capture.rendering.view_of_table import FROM_A_STAND, FROM_A_WRIST, draw_view
from pecgrasp_env.capture.scenarios.base import sample_seed
from pecgrasp_env.capture.scenes.arrangement import Arrangement, arrange_scene
from pecgrasp_env.capture.scenes.config import CAMERAS, FramesConfig
from pecgrasp_env.capture.scenes.frames import BIN_LABEL, FIRST_OBJECT, TABLE_LABEL, LabelledFrame
from pecgrasp_env.capture.scenes.object_pool import ObjectPool
from pecgrasp_env.capture.scenes.room import Box, draw_room
from pecgrasp_env.scene.placement import PlacementError, outline_of
from pecgrasp_env.sensor import CameraIntrinsics, D435Noise, apply_d435
from pecgrasp_env.sensor.structured_light_noise import StructuredLightNoise, apply_structured_light
from pecgrasp_env.sensor.surface_losses import draw_losses, lost_regions

__all__ = ["SceneMaker"]

_ARRANGEMENTS = 20
_VIEWS = 20
_LEAST_SHARE = 5e-4  # of the image's pixels, on some object of a view that is kept


class SceneMaker:
    """Makes scenes in one process, one renderer for all of them; each from its own seed, whatever was made before."""

    def __init__(self, config: FramesConfig) -> None:
        self._config = config
        self._pool = ObjectPool(config.objects)
        self._renderer = SceneRenderer()
        self._kinds, self._kind_weights = _weights(config.kinds)
        self._cameras, self._camera_weights = _weights(config.cameras)

    def frames(self, scene: int, rejected: Counter[str]) -> list[LabelledFrame]:
        """The frames of a scene; counts in `rejected` what was drawn anew, by reason."""
        config = self._config
        seed = sample_seed(config.seed, "scene", "", scene)
        rng = np.random.default_rng(seed)
        kind = int(rng.choice(len(self._kinds), p=self._kind_weights))
        arrangement = self._arrange(self._kinds[kind], rng, rejected)
        models, poses = arrangement.models, arrangement.poses
        outlines = [outline_of(model, pose) + pose[:2] for model, pose in zip(models, poses, strict=True)]
        if arrangement.box is not None:
            outlines.append(np.concatenate([_corners(*part) for part in arrangement.box.boxes()]))
        room = draw_room(np.concatenate(outlines), rng)
        boxes = [(TABLE_LABEL, *_placed(room.table))] + [(0, *_placed(box)) for box in room.others]
        if arrangement.box is not None:
            boxes += [(BIN_LABEL, half_size, pose) for half_size, pose in arrangement.box.boxes()]
        self._renderer.show(models, poses, boxes, FIRST_OBJECT)
        lost = _losses(len(models), rng)
        classes = np.array([self._pool.classes.index(model.class_name) for model in models])
        frames = []
        for _ in range(config.frames_per_scene):
            number = int(rng.choice(len(self._cameras), p=self._camera_weights))
            name = self._cameras[number]
            camera = CAMERAS[name]
            for _ in range(_VIEWS):
                middle = poses[:, :3].mean(axis=0) if rng.random() < 0.7 else poses[rng.integers(len(poses)), :3]
                T_world_camera = _view(middle, room.azimuths, name, rng)
                exact, labels = self._renderer.render(T_world_camera, camera)
                on_objects = np.bincount(labels.reshape(-1), minlength=256)[FIRST_OBJECT:BIN_LABEL]
                if on_objects.max() >= _LEAST_SHARE * labels.size:
                    break
                rejected["nothing in view"] += 1
            depth, labels = _measure(name, exact, labels, camera, lost, rng)
            shares = self._renderer.visible_shares(T_world_camera, camera)
            frames.append(
                LabelledFrame(
                    depth, labels, camera.matrix, T_world_camera, kind, number, scene, seed, config.is_val(scene),
                    classes, poses, shares,
                )
            )  # fmt: skip
        return frames

    @property
    def classes(self) -> tuple[str, ...]:
        return self._pool.classes

    def _arrange(self, kind: str, rng: np.random.Generator, rejected: Counter[str]) -> Arrangement:
        config = self._config
        for _ in range(_ARRANGEMENTS):
            # Half of the scenes have few objects.
            most = config.most if rng.random() < 0.5 else min(config.most, config.fewest + 6)
            models = self._pool.draw(kind, int(rng.integers(config.fewest, most + 1)), rng)
            try:
                return arrange_scene(kind, models, rng)
            except PlacementError:
                rejected[f"{kind}: not at rest"] += 1
        raise CaptureError(f"no scene of kind {kind!r} came to rest in {_ARRANGEMENTS} draws")


def _weights(weights: Mapping[str, float]) -> tuple[tuple[str, ...], np.ndarray]:
    values = np.array(list(weights.values()), float)
    return tuple(weights), values / values.sum()


def _losses(count: int, rng: np.random.Generator) -> np.ndarray:
    """(256,) by label: what a camera loses of each surface, those of objects, of the table and of all else."""
    lost = np.zeros(256, np.float32)
    lost[FIRST_OBJECT : FIRST_OBJECT + count] = draw_losses(count, rng)
    if rng.random() < 0.15:
        lost[TABLE_LABEL] = rng.uniform(0.0, 0.1)
    lost[0] = rng.choice([0.0, rng.uniform(0, 0.5)])
    return lost


def _measure(
    camera: str, exact: np.ndarray, labels: np.ndarray, intrinsics: CameraIntrinsics, lost: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Depth and labels as a camera of `CAMERAS` has them, with faults of a size of its own: devices differ."""
    if camera.startswith("structured_light"):
        light = StructuredLightNoise(
            subpixel_error=rng.uniform(0.05, 0.11), correlation=rng.uniform(1.5, 2.5), edge_jitter=rng.uniform(0.4, 1.1)
        )
        depth, source = apply_structured_light(exact, intrinsics, rng, light, lost[labels])
        return depth, labels.reshape(-1)[source]
    stereo = D435Noise(subpixel_error=rng.uniform(0.05, 0.1), patch_density=rng.uniform(0, 8))
    depth = apply_d435(exact, intrinsics, rng, stereo)
    depth[lost_regions(lost[labels], rng)] = 0
    return depth, labels


def _view(middle: np.ndarray, azimuths: tuple[float, float], camera: str, rng: np.random.Generator) -> np.ndarray:
    """T_world_camera (4, 4) of a camera of `CAMERAS`: structured light stands beside the table, and what is nearer than
    some 0.5 m it does not measure; every second D435 is on a wrist.
    """
    if camera.startswith("structured_light"):
        return draw_view(middle, azimuths, 0.6, rng)
    return draw_view(middle, azimuths, 0.45, rng, FROM_A_WRIST if rng.random() < 0.5 else FROM_A_STAND)


def _placed(box: Box) -> tuple[np.ndarray, sapien.Pose]:
    return box.half_size, sapien.Pose(box.centre, [np.cos(box.yaw / 2), 0, 0, np.sin(box.yaw / 2)])


def _corners(half_size: np.ndarray, pose: sapien.Pose) -> np.ndarray:
    """(4, 2) seen from above."""
    signs = np.array([[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]])
    matrix = pose.to_transformation_matrix()
    return ((signs * half_size) @ matrix[:3, :3].T + matrix[:3, 3])[:, :2]
