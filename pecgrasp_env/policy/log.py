"""What a policy notes of an episode, for reports."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from grasping import Grasp, GraspPlan
from pecgrasp_env.policy.seen_objects import SeenObject


@dataclass
class PolicyLog:
    """What happened in an episode.

    stages: seconds spent in each stage, one number each time it ran. failures: why each try failed that did.
    plan, grasp, chosen, confidence: of the last try. held_m, held_n: opening [m] and measured grip force [N, None where
    the observation has none] with which the object was held last. reason: why the policy gave up, or None. doubts:
    what it was unsure of and went on. cleared: how many objects it took off the asked-for one and put down. absent: it
    says that nothing of the asked-for class is there.
    """

    stages: dict[str, list[float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    views: int = 0
    plan: GraspPlan | None = None
    grasp: Grasp | None = None
    objects: list[SeenObject] = field(default_factory=list)
    chosen: int | None = None
    confidence: float = 0.0
    held_m: float | None = None
    held_n: float | None = None
    reason: str | None = None
    doubts: list[str] = field(default_factory=list)
    cleared: int = 0
    lifted: bool = False
    absent: bool = False
    doing: str = ""  # in words, for captions

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Note how long what happens inside takes."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.stages.setdefault(stage, []).append(time.perf_counter() - start)
