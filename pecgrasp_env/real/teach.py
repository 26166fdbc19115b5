"""A new class from a thing that lies alone before the camera: its cut-outs are labelled by its name."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from grasping import Scene, Segmenter
from pecgrasp_env.policy.perception import View
from pecgrasp_env.real.errors import ConnectionLost, RobotError
from pecgrasp_env.real.interfaces import DepthCamera, DepthImage
from pecgrasp_env.sensor.intrinsics import deproject

LEAST_VIEWS = 8
_FIRST_VIEWS = 3  # of which one must be good, before a person or an arm goes on for nothing
_FARTHEST_M = 0.06  # of a cut-out's middle from the others', both known in the base frame
_PLACEHOLDER = 200  # points of a cloud that no class is like


class TeachError(RobotError, ValueError):
    """From what was shown no class follows; the message says what lies there and the way out."""


class Teachable(Protocol):
    """A classifier that takes further classes, as `pec.Classifier` does."""

    @property
    def classes(self) -> list[str]: ...

    @property
    def n_points(self) -> int: ...

    def enrol(self, name: str, clouds: Sequence[np.ndarray]) -> Any: ...

    def predict(self, points: Any) -> Any: ...


@dataclass(frozen=True)
class Shown:
    """cloud: (M, 3) float32, camera frame, of the one thing there; None where there is none, and why. place: (3,) m,
    its middle in the base frame, where that is known. lay: views of one lay show it at one place.
    """

    cloud: np.ndarray | None
    why: str = ""
    place: np.ndarray | None = None
    lay: int = 0


@dataclass(frozen=True)
class Lesson:
    """What came of it.

    classifier: which knows the class. clouds: (n,) of (M, 3) that it was shown. left_out: reason → number of views.
    before: label → number of views, as the classifier called them that did not know it. recognised: of the views of
    one half those that it calls by the name once the other half is enrolled, and how many there are. seconds: that
    learning took.
    """

    classifier: Any
    clouds: list[np.ndarray]
    left_out: dict[str, int]
    before: dict[str, int]
    recognised: tuple[int, int]
    seconds: float


def check_name(classifier: Teachable, name: str) -> None:
    """Raises what `enrol` would raise for the name, or of a classifier that learns nothing: before anything moves."""
    classifier.enrol(name, [np.random.default_rng(0).normal(size=(_PLACEHOLDER, 3)).astype(np.float32)])


def shown_in_view(view: View, n_points: int) -> Shown:
    """The one thing in a view whose place in the base frame is known."""
    borders = [seen.touches_border for seen in view.objects]
    shown = _only(view.clouds, borders, n_points)
    return shown if shown.cloud is None else Shown(shown.cloud, place=view.objects[0].centroid)


def shown_in_image(image: DepthImage, n_points: int, segmenter: Segmenter | None = None) -> Shown:
    """The one thing in a depth image of a camera that is held upright, wherever it stands."""
    scene: Scene = (segmenter or Segmenter()).segment(deproject(image.depth, image.intrinsics))
    return _only(scene.objects, list(scene.touches_border), n_points)


def _only(clouds: Sequence[np.ndarray], borders: Sequence[bool], n_points: int) -> Shown:
    if not len(clouds):
        return Shown(None, "nothing on the table")
    if len(clouds) > 1:
        return Shown(None, "two things or more")
    if borders[0]:
        return Shown(None, "it is cut off by the edge of the image")
    if len(clouds[0]) < n_points:
        return Shown(None, f"it has fewer than {n_points} points: nearer")
    return Shown(np.asarray(clouds[0], np.float32))


def images_of(camera: DepthCamera) -> Iterator[DepthImage]:
    """All that a recorded camera holds."""
    while True:
        try:
            yield camera.grab()
        except ConnectionLost:
            return


def teach(
    classifier: Teachable,
    name: str,
    views: Iterable[Shown],
    least: int = LEAST_VIEWS,
    learn: Callable[[str, list[np.ndarray]], Any] | None = None,
) -> Lesson:
    """The classifier with one class more, of what the views show; `classifier` stays as it was.

    learn: name and clouds → what knows the class, where that is more than the classifier's own `enrol`.
    Raises TeachError where fewer than `least` views show one thing alone, and what `enrol` and `learn` raise.
    """
    check_name(classifier, name)
    good: list[Shown] = []
    left_out: Counter[str] = Counter()
    for number, shown in enumerate(views, start=1):
        if shown.cloud is None:
            left_out[shown.why] += 1
        else:
            good.append(shown)
        if number == _FIRST_VIEWS and not good:
            raise TeachError(f"{_told(left_out)} in the first {number} views: put the {name} on the table, alone")
    elsewhere = _elsewhere(good)
    clouds = [each.cloud for each, away in zip(good, elsewhere, strict=True) if not away and each.cloud is not None]
    if elsewhere.any():
        left_out["another place than in the other views"] += int(elsewhere.sum())
    if len(clouds) < least:
        n, seen = len(clouds), _told(left_out)
        reasons = f" ({seen})" if seen else ""
        raise TeachError(
            f"{n} views show one thing alone, {least} are needed{reasons}: show the {name} from more sides"
        )
    before = Counter(answer.label for answer in classifier.predict(clouds))
    half = classifier.enrol(name, clouds[::2])
    rest = clouds[1::2]
    recognised = sum(answer.label == name for answer in half.predict(rest))
    begun = time.monotonic()
    taught = (learn or classifier.enrol)(name, clouds)
    seconds = time.monotonic() - begun
    return Lesson(taught, clouds, dict(left_out), dict(before), (recognised, len(rest)), seconds)


def _elsewhere(shown: Sequence[Shown]) -> np.ndarray:
    """(n,) bool: whose thing lies farther from where most views of its lay see it; where no place is known, none."""
    places = np.array([np.full(3, np.nan) if each.place is None else each.place for each in shown]).reshape(-1, 3)
    known = np.isfinite(places).all(axis=1)
    lays = np.array([each.lay for each in shown], int)
    far = np.zeros(len(shown), bool)
    for lay in np.unique(lays[known]):
        mine = known & (lays == lay)
        far[mine] = np.linalg.norm((places - np.median(places[mine], axis=0))[mine, :2], axis=1) > _FARTHEST_M
    return far


def _told(left_out: Counter[str]) -> str:
    return ", ".join(f"{count} × {why}" for why, count in left_out.most_common())
