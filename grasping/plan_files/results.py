"""What came of planning on a file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasping.grasp import GraspPlan
from grasping.plan_files.left_out import SURE
from grasping.segmentation.scene import Scene

LARGE = 0.45  # m; what a scene's objects are at most, unless the segmenter is told otherwise


@dataclass(frozen=True)
class PlannedObject:
    """points: (M, 3), m, in the file's frame; surroundings: (K, 3), what is around it in a scene.

    cut_off: the image ends within it. confidence: how sure the segmenter is of it, in [0, 1], where it says. error: why
    the planner refused it.
    """

    name: str
    points: NDArray
    plan: GraspPlan
    plan_s: float
    surroundings: NDArray | None = None
    cut_off: bool = False
    confidence: float | None = None
    error: str | None = None

    @property
    def remarks(self) -> list[str]:
        """What makes the plan doubtful, and what it stands on."""
        doubts = ["cut off by the edge of the image"] if self.cut_off else []
        doubts += [f"planned on {self.plan.source}"] if self.plan.source is not None else []
        if self.confidence is not None and self.confidence < SURE:
            doubts.append(f"one thing with {100 * self.confidence:.0f} %")
        extent = float(np.ptp(self.points, axis=0).max()) if len(self.points) else 0.0
        if self.surroundings is None and extent > LARGE:
            doubts.append(f"{extent:.2f} m large; if this is a whole scene, say scene=true")
        return doubts


@dataclass(frozen=True)
class PlannedFile:
    """n_points: valid ones; None where the file was not read. scene: where it was taken for one, and then

    cloud: (N, 3), all of its points in the order of the file, m.
    """

    path: Path
    n_points: int | None = None
    objects: list[PlannedObject] = field(default_factory=list)
    scene: Scene | None = None
    cloud: NDArray | None = None
    read_s: float = 0.0
    segment_s: float = 0.0
    error: str | None = None

    @property
    def found(self) -> str:
        """How many objects stand in the scene, and why there is none of them or no table."""
        if not self.objects:
            return "no object found" + (f": {self.scene.summary()}" if self.scene is not None else "")
        found = f"{len(self.objects)} object" + "s" * (len(self.objects) > 1)
        if self.scene is not None and self.scene.plane is None:
            found += ", no table: " + next(each.why for each in self.scene.rejected if each.what == "plane")
        return found

    @property
    def failed(self) -> bool:
        """Whether the file, or the cloud in it, was refused; an object without a grasp is no failure."""
        return self.error is not None or any(each.error is not None for each in self.objects)
