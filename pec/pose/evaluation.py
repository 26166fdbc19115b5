"""How good the proposals are before any refinement, by the figures of the field."""

from __future__ import annotations

from typing import Any

import torch

from pec.pose.clouds import PosedClouds
from pec.pose.distance import PoseDistance, add, add_s
from pec.pose.hypotheses import Hypotheses, all_views
from pec.pose.models import PoseModels
from pec.pose.network import PoseNetwork

__all__ = ["evaluate", "predict", "proposal_figures"]

_TOGETHER = 256
_FEW = 300  # points of a model that figures are taken over, about


@torch.inference_mode()
def predict(network: PoseNetwork, distance: PoseDistance, clouds: PosedClouds) -> Hypotheses:
    """What the network says of all clouds, their first `n_points` points taken: those of farthest point sampling."""
    network.eval()
    n = network.config.n_points
    parts = [
        all_views(network, distance, points[:, :n], model)
        for points, model in zip(clouds.points.split(_TOGETHER), clouds.model.split(_TOGETHER), strict=True)
    ]
    return Hypotheses(*(torch.cat(values) for values in zip(*parts, strict=True)))


def proposal_figures(network: PoseNetwork, distance: PoseDistance, clouds: PosedClouds) -> dict[str, float]:
    """Means over the clouds of the distance in the model's radii of the "likeliest" proposal and of the "nearest"."""
    said = predict(network, distance, clouds)
    gap = distance(said.centre, said.rotation, clouds.T_camera_object, clouds.model)
    likeliest = gap.gather(1, said.expected.argmin(dim=1, keepdim=True))
    return {"likeliest": float(likeliest.mean()), "nearest": float(gap.amin(dim=1).mean())}


def evaluate(
    network: PoseNetwork, distance: PoseDistance, models: PoseModels, clouds: PosedClouds
) -> dict[str, dict[str, Any]]:
    """For each model, and "all" as the mean over models: shares of clouds, of the likeliest proposal and the nearest.

    add_10: ADD (least over the model's symmetries) under 10 % of the diameter; add_s_2cm: ADD-S under 2 cm. n: clouds.
    """
    said = predict(network, distance, clouds)
    gap = distance(said.centre, said.rotation, clouds.T_camera_object, clouds.model)
    poses = said.poses(distance.centres[clouds.model]).double().cpu().numpy()
    truth = clouds.T_camera_object.double().cpu().numpy()
    chosen = {"likeliest": said.expected.argmin(dim=1).tolist(), "nearest": gap.argmin(dim=1).tolist()}
    spaced = max(1, models.points.shape[1] // _FEW)
    rows: dict[str, dict[str, Any]] = {}
    for m, name in enumerate(models.names):
        of_model = (clouds.model == m).nonzero()[:, 0].tolist()
        points, symmetries = models.points[m, ::spaced].astype(float), models.symmetries[m].astype(float)
        tenth = 0.1 * float(models.diameters[m])
        row: dict[str, Any] = {"n": len(of_model)}
        for which, best in chosen.items():
            estimates = [(poses[i, best[i]], truth[i]) for i in of_model]
            within = [add(pose, true, points, symmetries) < tenth for pose, true in estimates]
            near = [add_s(pose, true, points) < 0.02 for pose, true in estimates]
            row[which] = {
                "add_10": sum(within) / max(len(within), 1),
                "add_s_2cm": sum(near) / max(len(near), 1),
            }
        rows[name] = row
    with_clouds = [row for row in rows.values() if row["n"]]
    rows["all"] = {"n": len(clouds)} | {
        which: {
            figure: sum(row[which][figure] for row in with_clouds) / len(with_clouds)
            for figure in ("add_10", "add_s_2cm")
        }
        for which in chosen
    }
    return rows
