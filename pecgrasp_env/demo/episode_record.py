"""What is kept of one episode for the report: what was seen, what was planned, how it ended; on disk without pickle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasping import Grasp, GraspPlan, RegionReport
from pec.common.atomic_files import replacing
from pecgrasp_env.evaluation.episode import Episode


@dataclass(frozen=True)
class ClassifiedObject:
    """One object as segmented and classified. points: (M, 3) metres, in the frame of the episode's cloud.

    confidence: probability of `label`; 0 where the object had too few points to be classified.
    """

    points: np.ndarray
    label: str
    confidence: float
    chosen: bool = False


@dataclass(frozen=True)
class EpisodeRecord:
    """An episode and what the policy saw and planned last.

    cloud: (N, 3) metres, the last frame that was looked at, z up; objects and plan are in its frame. picture: (H, W, 3)
    uint8 of the scene before the first step. film_second: where the episode begins in the film.
    """

    episode: Episode
    objects: Sequence[ClassifiedObject] = ()
    cloud: np.ndarray | None = None
    plan: GraspPlan | None = None
    picture: np.ndarray | None = None
    film_second: float | None = None


def save_record(path: Path, record: EpisodeRecord) -> None:
    """Writes one .npz: arrays as they are, the rest as JSON. Whole or not at all."""
    arrays: dict[str, np.ndarray] = {}
    described: dict[str, Any] = {"episode": asdict(record.episode), "film_second": record.film_second}
    for name in ("cloud", "picture"):
        if getattr(record, name) is not None:
            arrays[name] = getattr(record, name)
    described["objects"] = []
    for k, seen in enumerate(record.objects):
        arrays[f"object_{k}"] = np.asarray(seen.points, np.float32)
        described["objects"].append([seen.label, seen.confidence, seen.chosen])
    if record.plan is not None:
        plan = record.plan
        described["plan"] = {"reason": plan.reason, "regions": [], "candidates": []}
        for k, region in enumerate(plan.regions):
            arrays[f"region_{k}"] = np.asarray(region.points, np.float32)
            rest = (region.primitive, float(region.width), float(region.curvature), region.verdict)
            described["plan"]["regions"].append([*rest, region.slab, region.cluster])
        for k, grasp in enumerate(plan.candidates):
            arrays[f"pose_{k}"] = grasp.pose
            terms = {name: float(value) for name, value in grasp.terms.items()}
            described["plan"]["candidates"].append(
                [float(grasp.width), float(grasp.score), grasp.kind, grasp.region, terms]
            )
    arrays["json"] = np.frombuffer(json.dumps(described).encode(), np.uint8)
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]


def load_record(path: Path) -> EpisodeRecord:
    """What `save_record` wrote."""
    with np.load(path, allow_pickle=False) as stored:
        arrays = dict(stored)
    described = json.loads(arrays["json"].tobytes())
    plan = None
    if "plan" in described:
        regions = [RegionReport(arrays[f"region_{k}"], *rest) for k, rest in enumerate(described["plan"]["regions"])]
        grasps = [Grasp(arrays[f"pose_{k}"], *rest) for k, rest in enumerate(described["plan"]["candidates"])]
        plan = GraspPlan(grasps[0] if grasps else None, grasps, regions, described["plan"]["reason"])
    return EpisodeRecord(
        Episode(**described["episode"]),
        [ClassifiedObject(arrays[f"object_{k}"], *rest) for k, rest in enumerate(described["objects"])],
        arrays.get("cloud"),
        plan,
        arrays.get("picture"),
        described["film_second"],
    )
