"""From a frame of a scene to a grasp on the object that was asked for, or to the word that it is not there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError
from grasping.grasp import GraspPlan, GraspPlanner
from grasping.segmentation.scene import Scene
from grasping.segmentation.segmenter import Segmenter

FloatArray = NDArray[np.float64]

SURE = 0.9  # probability of the class from which one look is enough
POSSIBLE = 0.1  # from which an object may be of the class
CERTAIN = 0.7  # that an object is one, below which it is to be looked at again


class Answer(Protocol):
    """What a classifier may answer instead of two values; `pec.Prediction` is one.

    label, confidence: the likeliest class, "unknown" for none of them, and its probability if it is of one of them.
    probabilities: of every class, if it is of one of them. known: in [0, 1], how likely it is of one of them.
    """

    @property
    def label(self) -> str: ...
    @property
    def confidence(self) -> float: ...
    @property
    def probabilities(self) -> Mapping[str, float]: ...
    @property
    def known(self) -> float: ...


Classify = Callable[[FloatArray], "tuple[str, float] | Answer"]


@dataclass(frozen=True)
class Selection:
    """What was seen, what it was taken for, and what to do.

    labels, confidences: one for each of `scene.objects`; known: of each how likely it is of any class, 1 where the
    classifier does not say. chosen: index of the object to grasp, or None. plan: its plan, or that of the likeliest
    object of the class where none of them can be grasped. reason: why nothing was chosen. doubt: why the scene should
    be looked at from another view before anything is touched, or before it is said that the class is not there; None
    where this view is enough.
    """

    scene: Scene
    labels: list[str]
    confidences: list[float]
    chosen: int | None
    plan: GraspPlan | None
    reason: str | None
    known: list[float] = field(default_factory=list)
    doubt: str | None = None
    absent: bool = False
    """Whether nothing of the class was seen, and nothing that may be of it."""


class SelectiveGrasper:
    """Segment a frame, classify each object, and plan on those of the asked-for class, the likeliest first.

    classify: an object's cloud (M, 3), in the frame of the scene's cloud → (label, confidence in [0, 1]), or an
    `Answer`, such as `pec.Classifier.predict` gives. min_confidence: objects of the class below it are not touched.
    """

    def __init__(
        self, classify: Classify, planner: GraspPlanner, segmenter: Segmenter | None = None, min_confidence: float = 0.0
    ) -> None:
        if not 0.0 <= min_confidence <= 1.0:
            raise ConfigError(f"min_confidence = {min_confidence!r} must be between 0 and 1")
        self.classify = classify
        self.planner = planner
        self.segmenter = Segmenter() if segmenter is None else segmenter
        self.min_confidence = min_confidence

    def select(
        self, cloud: ArrayLike, target: str, *, up: ArrayLike | None = None, robot: ArrayLike | None = None
    ) -> Selection:
        """Choose and plan in the cloud (N, 3) or (H, W, 3) of a scene; `up` and `robot` as for `Segmenter.segment`.

        Raises CloudError and ConfigError as the segmenter and the planner do.
        """
        scene = self.segmenter.segment(cloud, up=up, robot=robot)
        answers = [self.classify(points) for points in scene.objects]
        labels = [str(each[0] if isinstance(each, tuple) else each.label) for each in answers]
        confidences = [float(each[1] if isinstance(each, tuple) else each.confidence) for each in answers]
        known = [_known(each) for each in answers]

        def selection(
            chosen: int | None, plan: GraspPlan | None, reason: str | None, doubt: str | None, absent: bool = False
        ) -> Selection:
            return Selection(scene, labels, confidences, chosen, plan, reason, known, doubt, absent)

        if not scene.objects:
            return selection(None, None, "no object was found on the table: " + scene.summary(), None, True)
        wanted = [i for i, label in enumerate(labels) if label == target]
        if not wanted:
            doubt = _may_be_there(answers, scene.certainties(), target)
            return selection(None, None, _none_of(target, labels, confidences, scene), doubt, doubt is None)
        sure = [i for i in wanted if confidences[i] >= self.min_confidence]
        if not sure:
            best = max(confidences[i] for i in wanted)
            reason = f"a {target} only with confidence {best:.2f}, below {self.min_confidence:.2f}"
            return selection(None, None, reason, reason)

        # An object that the image cuts off is planned on last: its other part may be anywhere.
        sure.sort(key=lambda i: (scene.touches_border[i], -confidences[i] * known[i]))
        first_plan: GraspPlan | None = None
        for index in sure:
            others = [points for i, points in enumerate(scene.objects) if i != index] + scene.obstacles
            plan = self.planner.plan(
                scene.objects[index],
                up=up,
                table=scene.plane,
                obstacles=np.vstack(others) if others else None,
                viewpoint=scene.viewpoint,
                unseen=scene.unseen[index],
            )
            if plan.best is not None:
                doubt = _unsure(target, confidences[index], known[index], scene.certainties()[index])
                return selection(index, plan, None, doubt)
            first_plan = plan if first_plan is None else first_plan
        why = "" if first_plan is None else first_plan.reason
        return selection(None, first_plan, f"the {target} cannot be grasped: {why}", None)


def _known(answer: tuple[str, float] | Answer) -> float:
    return 1.0 if isinstance(answer, tuple) else float(answer.known)


def _none_of(target: str, labels: Sequence[str], confidences: Sequence[float], scene: Scene) -> str:
    seen = ", ".join(f"{label} ({c:.2f})" for label, c in zip(labels, confidences, strict=True))
    rest = [each for each in scene.rejected if each.what == "cluster" and each.way_out]
    left_out = "; ".join(f"{each.n_points} points: {each.why} (say {each.way_out})" for each in rest)
    return f"no {target} among the objects: {seen}" + (left_out and f"; left out: {left_out}")


def _may_be_there(
    answers: Sequence[tuple[str, float] | Answer], certainties: Sequence[float], target: str
) -> str | None:
    """Why the class may be there although no object is called so, or None."""
    for answer in answers:
        share = 0.0 if isinstance(answer, tuple) else float(answer.known) * float(answer.probabilities.get(target, 0.0))
        if share >= POSSIBLE:
            return f"one of the objects may be a {target} ({share:.2f})"
    if min(certainties) < CERTAIN:
        return f"whether one of the objects is one is unsure ({min(certainties):.2f})"
    return None


def _unsure(target: str, confidence: float, known: float, certainty: float) -> str | None:
    """Why the chosen object should be looked at again, or None."""
    if confidence * known < SURE:
        return f"whether it is a {target} is unsure ({confidence * known:.2f})"
    if certainty < CERTAIN:
        return f"whether the {target} is one object is unsure ({certainty:.2f})"
    return None
