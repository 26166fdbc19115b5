"""The objects that scenes draw from: catalogue, plain shapes, and the user's meshes."""

from __future__ import annotations

import warnings

import numpy as np

from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.capture.scenes.config import SceneObjectsConfig
from pecgrasp_env.objects import CLASSES, MeshFolder, ObjectError, ObjectModel, make_object
from pecgrasp_env.objects.mesh_folder import MeshWarning
from pecgrasp_env.objects.procedural.primitives import CONTAINERS, PRIMITIVES, make_primitive

__all__ = ["ObjectPool"]

_LARGEST_M = 0.4  # of what lies on a table with others
_LARGE_SHARE = 0.4  # of the scenes in which things are as large as cartons, jars and pans
_LARGE_M = 0.07  # of their middle side
_DRAWS = 50
_TRIES = 5


class ObjectPool:
    """classes: what a frame's class_index counts; the folder's come last."""

    def __init__(self, config: SceneObjectsConfig) -> None:
        """Raises ObjectError for a folder that is missing or empty."""
        self._config = config
        self._folder = None
        if config.path is not None:
            self._folder = MeshFolder(config.path, config.scale, allow_open=config.allow_open)
        self._own = (*CLASSES, *PRIMITIVES)
        theirs = () if self._folder is None else self._folder.classes
        self.classes = self._own + tuple(name for name in theirs if name not in self._own)

    def draw(self, kind: str, count: int, rng: np.random.Generator) -> list[ObjectModel]:
        """Objects for a scene of a kind. In one of three scenes most are of one class or two, as on real tables."""
        favourites = None
        if rng.random() < 0.33:
            favourites = [self._any_class(rng) for _ in range(int(rng.integers(1, 3)))]
        least = _LARGE_M if rng.random() < _LARGE_SHARE else 0.0
        models = [self._one(favourites, least, rng) for _ in range(count)]
        if kind == "contained":
            models[0] = self._drawn(str(rng.choice([*CONTAINERS, "bowl"])), rng)
        return models

    def _one(self, favourites: list[str] | None, least: float, rng: np.random.Generator) -> ObjectModel:
        """An object, if possible one whose middle side is `least` m long."""
        if self._folder is not None and rng.random() < self._config.share:
            return self._from_folder(self._folder, rng)
        for _ in range(_TRIES):
            name = str(rng.choice(favourites)) if favourites and rng.random() < 0.8 else self._any_class(rng)
            model = self._drawn(name, rng)
            if np.sort(model.extents)[1] >= least:
                break
        return model

    def _any_class(self, rng: np.random.Generator) -> str:
        if rng.random() < self._config.plain_share:
            names = tuple(PRIMITIVES)
            weights = np.array([3.0 if name in ("cuboid", "cylinder") else 1.0 for name in names])
            return str(rng.choice(names, p=weights / weights.sum()))
        return str(rng.choice(self._config.classes or CLASSES))

    def _drawn(self, name: str, rng: np.random.Generator) -> ObjectModel:
        config = self._config
        if name in PRIMITIVES:
            return make_primitive(name, config.seed + int(rng.integers(config.plain_instances)))
        return make_object(name, config.seed + int(rng.integers(config.catalogue_instances)))

    def _from_folder(self, folder: MeshFolder, rng: np.random.Generator) -> ObjectModel:
        failed: Exception | str = f"none of its objects is at most {_LARGEST_M} m long"
        for _ in range(_DRAWS):
            name = str(rng.choice(folder.classes))
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", MeshWarning)
                    model = folder.load(name, int(rng.integers(len(folder.names(name)))))
            except ObjectError as error:
                failed = error
                continue
            if model.extents.max() <= _LARGEST_M:
                return model
        raise CaptureError(f"objects.path={self._config.path}: no mesh of {_DRAWS} drawn ones can be used: {failed}")
