"""How soon a raw cloud has a class and a confidence, by ours and the rivals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pecgrasp_env.benchmark.timing import Row, Timing, limited, rows_of, side_by_side
from pecgrasp_env.objects import LARS_CLASSES, make_object

_POINTS = 64  # that every classifier takes
_SCENE = 6  # clouds of one scene
_KNOWN = 1000  # clouds that k-nearest-neighbour knows; its time grows with them


def classification(settings: Mapping[str, Any]) -> list[Row]:
    """From one raw cloud to class and confidence on one thread, beside a k-d tree of the same cloud.

    default, published: PEC by the default and by the published preprocessing; upright: ModelNet10's, four views. Then
    the rivals on as many points, in the order of farthest point sampling. Last, ours on all clouds of a scene at once.
    """
    limits = {int(n): most for n, most in settings.get("classify_at_most", {}).items()}
    ours, rivals = _classifiers(settings["seed"])
    mesh = make_object("stapler", settings["seed"]).visual_mesh()
    rows = []
    for n in settings["classified_sizes"]:
        points = np.asarray(mesh.sample(n, seed=settings["seed"]), np.float32)
        routines: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, classifier in (ours | rivals).items():
            routines[name] = partial(classifier.predict, points)
        of_size = rows_of(
            side_by_side(routines, settings["repeats"], warm=True), "k-d tree", f"{n:,} points, {_POINTS} taken"
        )
        of_size = [limited(row, limits.get(n) if row["name"] in ours else None) for row in of_size]
        scene: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, classifier in ours.items():
            scene[name] = partial(classifier.predict, [points] * _SCENE)
        times = side_by_side(scene, settings["repeats"], warm=True)
        each = {
            name: time if name == "k-d tree" else Timing(time.wall / _SCENE, time.cpu / _SCENE)
            for name, time in times.items()
        }
        rows += of_size + rows_of(each, "k-d tree", f"{n:,} points, one of {_SCENE} clouds at once")[1:]
    return rows


def _classifiers(seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Ours and the rivals by name, with fresh weights, which do not matter to the time."""
    import torch

    from pec import Classifier
    from pec.checkpoint import Checkpoint
    from pec.networks.baselines import Memorising
    from pec.networks.registry import MODELS, build_model
    from pec.preprocessing.preprocess import Preprocess
    from pec.training.config import DatasetConfig, TrainConfig

    torch.manual_seed(seed)
    classes = list(LARS_CLASSES)

    def classifier(network: str, preprocess: Preprocess) -> Classifier:
        model = build_model(network, _POINTS, len(classes)).eval()
        if isinstance(model, Memorising):
            model.fit(torch.randn(_KNOWN, _POINTS, 3), torch.arange(_KNOWN) % len(classes))
        return Classifier(Checkpoint(model, classes, preprocess, 1.0, 0, network))

    upright = Preprocess(n_candidates=1024, sampling="random", pose="upright", ordering="anchors", anchor_unit="cloud")
    ours = {
        "default": classifier("pec", TrainConfig(DatasetConfig(""), "").preprocess),
        "published": classifier("pec", Preprocess(ordering="groups", group_size=16)),
        "pec upright": classifier("pec", replace(upright, size="root")),
        "pec2 upright": classifier("pec2", upright),
    }
    rivals = [name for name in MODELS if not name.startswith("pec")]
    return ours, {name: classifier(name, Preprocess(ordering="none")) for name in rivals}
