"""From a frame of a scene to a grasp on the object that was asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError
from grasping.grasp import GraspPlan, GraspPlanner
from grasping.segmentation.scene import Scene
from grasping.segmentation.segmenter import Segmenter

FloatArray = NDArray[np.float64]
Classify = Callable[[FloatArray], tuple[str, float]]


@dataclass(frozen=True)
class Selection:
    """What was seen, what it was taken for, and what to do.

    labels, confidences: one for each of `scene.objects`. chosen: index of the object to grasp, or None. plan: its plan,
    or that of the likeliest object of the class where none of them can be grasped. reason: why nothing was chosen.
    """

    scene: Scene
    labels: list[str]
    confidences: list[float]
    chosen: int | None
    plan: GraspPlan | None
    reason: str | None


class SelectiveGrasper:
    """Segment a frame, classify each object, and plan on those of the asked-for class, the likeliest first.

    classify: an object's cloud (M, 3), in the frame of the scene's cloud → (label, confidence in [0, 1]).
    min_confidence: objects of the class below it are not touched.
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
        labels = [str(label) for label, _ in answers]
        confidences = [float(confidence) for _, confidence in answers]

        def chosen_none(plan: GraspPlan | None, reason: str) -> Selection:
            return Selection(scene, labels, confidences, None, plan, reason)

        if not scene.objects:
            return chosen_none(None, "no object was found on the table: " + scene.summary())
        wanted = [i for i, label in enumerate(labels) if label == target]
        if not wanted:
            seen = ", ".join(f"{label} ({c:.2f})" for label, c in zip(labels, confidences, strict=True))
            rest = [each for each in scene.rejected if each.what == "cluster" and each.way_out]
            left_out = "; ".join(f"{each.n_points} points: {each.why} (say {each.way_out})" for each in rest)
            return chosen_none(
                None, f"no {target} among the objects: {seen}" + (left_out and f"; left out: {left_out}")
            )
        sure = [i for i in wanted if confidences[i] >= self.min_confidence]
        if not sure:
            best = max(confidences[i] for i in wanted)
            return chosen_none(None, f"a {target} only with confidence {best:.2f}, below {self.min_confidence:.2f}")

        # An object that the image cuts off is planned on last: its other part may be anywhere.
        sure.sort(key=lambda i: (scene.touches_border[i], -confidences[i]))
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
                return Selection(scene, labels, confidences, index, plan, None)
            first_plan = plan if first_plan is None else first_plan
        why = "" if first_plan is None else first_plan.reason
        return chosen_none(first_plan, f"the {target} cannot be grasped: {why}")
