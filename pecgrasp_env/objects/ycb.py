"""The five classes of the published YCB set: look-alikes out of the catalogue, or ManiSkill's copy of the real meshes.

YCB: Calli et al., "The YCB object and model set", ICAR 2015. It has no game controller, though the published set seems
to (the names of its classes are read off a picture), so that class is a look-alike in either case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.folder_layout import mesh_of_object
from pecgrasp_env.objects.mesh_folder import load_mesh
from pecgrasp_env.objects.model import ObjectModel
from pecgrasp_env.objects.procedural.catalogue import Catalogue, make_object

__all__ = ["LOOK_ALIKES", "YCB_CLASSES", "YcbDownload", "YcbLookAlikes", "find_models"]

LOOK_ALIKES = {
    "mug": "mug",
    "tuna_can": "can",
    "controller": "joypad",
    "bowl": "bowl",
    "mustard_bottle": "bottle",
}
"""Class of the set → class of the procedural catalogue."""
YCB_CLASSES = tuple(LOOK_ALIKES)
_MODELS = {
    "mug": "025_mug",
    "tuna_can": "007_tuna_fish_can",
    "bowl": "024_bowl",
    "mustard_bottle": "006_mustard_bottle",
}
_MESHES = ("*", "*/*")  # of a model: ManiSkill's 025_mug/textured.obj, YCB's own 025_mug/google_16k/textured.obj


class YcbLookAlikes:
    """`instances_per_class` draws of the catalogue's likest class for each class; seeds as in `Catalogue`."""

    def __init__(
        self, classes: Sequence[str] | None = None, instances_per_class: int | None = None, seed: int = 0
    ) -> None:
        self.classes = _chosen(classes)
        self._catalogue = Catalogue([LOOK_ALIKES[name] for name in self.classes], instances_per_class or 1, seed)

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order: those of the catalogue."""
        return self._catalogue.names(_look_alike(class_name))

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` of a class. Raises ObjectError for an unknown class or instance."""
        if not 0 <= i < self._catalogue.instances_per_class:
            raise ObjectError(
                f"{class_name} has instances 0 to {self._catalogue.instances_per_class - 1}, asked for {i}"
            )
        return _renamed(class_name, self._catalogue.seed + i)

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        return f"look-alike: {_look_alike(class_name)} of the procedural catalogue"


class YcbDownload:
    """One real mesh a class, of ManiSkill's download; the controller is a look-alike.

    models: folder of the models as `find_models` finds it; None: ManiSkill's own, downloaded at the first use.
    Raises ObjectError where it cannot be downloaded, or a class's mesh is not there.
    """

    def __init__(self, classes: Sequence[str] | None = None, seed: int = 0, models: Path | None = None) -> None:
        self.classes = _chosen(classes)
        self._look_alikes = YcbLookAlikes(self.classes, 1, seed)
        wanted = [_MODELS[name] for name in self.classes if name in _MODELS]
        self._folder = Path() if not wanted else _downloaded() if models is None else models
        for name in wanted:
            if not (self._folder / name).is_dir():
                raise ObjectError(
                    f"{self._folder / name} does not exist: the YCB models are incomplete. Fetch it, or leave its "
                    "class out of objects.classes"
                )
            mesh_of_object(self._folder / name)  # raises where it has no mesh
        self._loaded: dict[str, ObjectModel] = {}

    def names(self, class_name: str) -> list[str]:
        """The name of the class's one instance: that of the model in YCB."""
        return [_MODELS[class_name]] if class_name in _MODELS else self._look_alikes.names(class_name)

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance 0 of a class. Raises ObjectError for an unknown class or instance, and as `load_mesh` does."""
        _look_alike(class_name)
        if class_name not in _MODELS or i != 0:
            return self._look_alikes.load(class_name, i)
        if class_name not in self._loaded:
            name = _MODELS[class_name]
            # A scan may have holes where it stood; it is taken as it is.
            source = mesh_of_object(self._folder / name)
            self._loaded[class_name] = load_mesh(source, class_name, scale=1.0, allow_open=True)
        return self._loaded[class_name]

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        if class_name in _MODELS:
            return f"YCB mesh {_MODELS[class_name]}"
        return self._look_alikes.origin(class_name, i)


def find_models(path: str | Path) -> Path | None:
    """The folder whose subfolders are YCB models, 025_mug/textured.obj in ManiSkill's layout or
    025_mug/google_16k/textured.obj in YCB's own, where `path` is it, the mani_skill2_ycb or ycb that holds it, or the
    assets or data folder above that; else None.
    """
    below = ("", "models", "ycb", "mani_skill2_ycb/models", "assets/mani_skill2_ycb/models")
    folders = (Path(path, *part.split("/")) for part in below)
    return next((folder for folder in folders if _has_models(folder)), None)


def _has_models(folder: Path) -> bool:
    models = [model for model in folder.glob("[0-9][0-9][0-9]_*") if model.is_dir()]
    return any(
        file.suffix in (".obj", ".ply", ".stl") for model in models for form in _MESHES for file in model.glob(form)
    )


def _chosen(classes: Sequence[str] | None) -> tuple[str, ...]:
    for name in classes or ():
        _look_alike(name)
    return tuple(classes) if classes else YCB_CLASSES


def _look_alike(class_name: str) -> str:
    if class_name not in LOOK_ALIKES:
        raise ObjectError(f"unknown object class {class_name!r}; the YCB set has {', '.join(YCB_CLASSES)}")
    return LOOK_ALIKES[class_name]


@lru_cache(maxsize=256)
def _renamed(class_name: str, seed: int) -> ObjectModel:
    return replace(make_object(_look_alike(class_name), seed), class_name=class_name)


def _downloaded() -> Path:
    """The folder of ManiSkill's YCB models, fetched where it is not there yet."""
    from mani_skill import ASSET_DIR

    folder = Path(ASSET_DIR) / "assets" / "mani_skill2_ycb" / "models"
    if not folder.is_dir():
        from mani_skill.utils.assets.data import DATA_SOURCES
        from mani_skill.utils.download_asset import download

        try:
            download(DATA_SOURCES["ycb"], verbose=False, non_interactive=True)
        except (OSError, SystemExit, ValueError) as error:  # no network, no access, a broken archive
            reason = f"{type(error).__name__}: {error}"
        else:
            reason = "the download left no models"
        if not folder.is_dir():
            raise ObjectError(
                f"ManiSkill could not download the YCB meshes to {folder} ({reason}). Give a folder of your own, "
                "objects.path=FOLDER with FOLDER/<class>/<mesh>, or leave objects.download=false for look-alikes"
            )
    return folder
