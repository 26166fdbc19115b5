"""One object alone on the robot's table, seen once by a D435, and what becomes of grasps on it.

It lies as in `tabletop`, where the arm reaches it, and is looked at and cut out as there; the world is the robot's base
frame, so an arm can try the same grasps. What the camera saw is all that the planner and a learner get; antipodal
grasps are drawn on the whole object.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence

import numpy as np

from pec.grasps.labels import GraspScene
from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.capture.grasps.candidates import Candidates, CandidateSampler
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.first_grasps import FirstGrasps
from pecgrasp_env.capture.grasps.trials import TrialBench
from pecgrasp_env.capture.scenarios.base import Captured, Subject, sample_seed
from pecgrasp_env.capture.scenarios.tabletop import MOST_FRAMES, TabletopScenario
from pecgrasp_env.policy.grip_force import grip_force

__all__ = ["GraspScenario"]


class GraspScenario:
    """Tries grasps on objects, each in scenes of its own."""

    def __init__(self, config: GraspsConfig) -> None:
        self._config = config
        self._views = _LoneObject(config.capture)
        self._sampler = FirstGrasps(config.planners) if config.planners else CandidateSampler(config.samplers)

    def capture(self, subjects: Sequence[Subject], first: int, count: int) -> Captured[GraspScene]:
        captured = Captured[GraspScene]()
        for subject in subjects:
            try:
                captured.samples += self._scenes(subject, first, count, captured.rejected)
            except CaptureError as error:
                captured.given_up[subject.name] = str(error)
        return captured

    def _scenes(self, subject: Subject, first: int, count: int, rejected: Counter[str]) -> list[GraspScene]:
        model, per_scene = subject.model, self._config.grasps_per_scene
        views, drawn, forces = [], [], []
        for number in range(first, first + count):
            points, T_world_camera, T_world_object = self._views.seen(subject, number, rejected)
            seed = sample_seed(self._config.capture.seed, model.class_name, model.instance, number)
            rng = np.random.default_rng((seed, 1))
            grasps = self._sampler.draw(model, T_world_object, points, T_world_camera[:3, 3], per_scene, rng)
            rejected["no grasp found"] += per_scene - len(grasps.widths)
            views.append((points.astype(np.float32), T_world_camera, T_world_object))
            drawn.append(grasps)
            forces.append(grip_force(points, None, slipped=False))
        outcomes = self._tried(subject, [T_world_object for *_, T_world_object in views], drawn, forces)
        return [
            GraspScene(
                model.class_name,
                model.instance,
                *view,
                T_world_grasp=grasps.poses.astype(np.float32),
                widths=grasps.widths.astype(np.float32),
                openings=grasps.openings.astype(np.float32),
                sampler=grasps.sampler,
                outcome=outcome,
            )
            for view, grasps, outcome in zip(views, drawn, outcomes, strict=True)
        ]

    def _tried(
        self, subject: Subject, lying: list[np.ndarray], drawn: list[Candidates], forces: list[float]
    ) -> list[np.ndarray]:
        """The outcomes of each scene's grasps. All are tried together, so that no cell stays empty."""
        counts = [len(grasps.widths) for grasps in drawn]
        if not sum(counts):
            return [np.zeros(0, np.uint8) for _ in drawn]
        bench = TrialBench(subject.model, min(self._config.cells, sum(counts)))
        outcomes = bench.run(
            np.repeat(np.stack(lying), counts, axis=0),
            np.concatenate([grasps.poses for grasps in drawn]),
            np.concatenate([grasps.openings for grasps in drawn]),
            np.repeat(forces, counts),
        )
        return np.split(outcomes, np.cumsum(counts)[:-1])


class _LoneObject(TabletopScenario):
    """The views of `tabletop`, of one object, with where it lies and where the camera stands."""

    def seen(self, subject: Subject, number: int, rejected: Counter[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The cloud (N, 3) float64 of scene `number`, T_world_camera and T_world_object (4, 4).

        Raises CaptureError for an object that cannot be captured.
        """
        self._check(subject.model)
        self._renderer.show([subject.model])
        reasons: Counter[str] = Counter()
        frames = self._frames([subject.model], f"scene {number}", subject.name)
        for layout, table in itertools.islice(frames, MOST_FRAMES):
            sample = self._cut(layout, table, [subject], {0: reasons}, rejected).get(0)
            if sample is not None:
                rejected += reasons
                T = layout.T_base_camera
                return sample.points.astype(float) @ T[:3, :3].T + T[:3, 3], T, T @ sample.T_camera_object
        why = ", ".join(f"{reason}: {n}" for reason, n in reasons.most_common())
        raise CaptureError(f"{MOST_FRAMES} frames in a row gave no cloud of it ({why})")
