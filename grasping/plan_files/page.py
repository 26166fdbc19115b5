"""The page that planning on files leaves: a table, and for each scene and each object a figure to turn around."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files as package_files

import numpy as np
from numpy.typing import ArrayLike

from grasping.grasp import Grasp
from grasping.gripper import Gripper
from grasping.plan_files.left_out import left_out
from grasping.plan_files.results import PlannedFile, PlannedObject
from grasping.plan_files.scene_layers import scene_layers
from grasping.viewer.figure import Layer, fragment, score_rgb
from grasping.viewer.html import page, templates

_ALL_POINTS = 400_000  # of all figures together: 3.5 MB
_GRASPS = "Grasps"  # the view in which objects have the colours of their scores


def plan_page(
    files: Sequence[PlannedFile], gripper: Gripper, planner: str, up: ArrayLike | None = None, command: str = ""
) -> str:
    """A self-contained HTML document. up: as it was given to the planner; where it was not, a scene's table says it."""
    objects = [each for file in files for each in file.objects]
    figures = len(objects) + sum(file.scene is not None for file in files)
    budget = int(np.clip(_ALL_POINTS // max(1, figures), 1500, 20_000))

    def up_of(file: PlannedFile) -> np.ndarray | None:
        if up is None and file.scene is not None and file.scene.plane is not None:
            return np.asarray(file.scene.plane[:3], dtype=np.float64)
        return None if up is None else np.asarray(up, dtype=np.float64)

    def scene_figure(file: PlannedFile, upward: np.ndarray | None) -> str:
        if not file.n_points:
            return ""
        layers = [] if file.scene is None or file.cloud is None else scene_layers(file.cloud, file.scene)
        layers += [_layer(each, each.plan.best) for each in file.objects]
        return fragment(gripper=gripper, layers=layers, up=upward, max_points=2 * budget)

    def object_figure(each: PlannedObject, upward: np.ndarray | None) -> str:
        if not len(each.points):
            return ""
        layers = [] if each.plan.regions else [_layer(each)]
        return fragment(each.plan, each.surroundings, gripper=gripper, layers=layers, up=upward, max_points=budget)

    title = f"Grasps on {files[0].path.name}" if len(files) == 1 else f"Grasps on {len(files)} clouds"
    body = templates("grasping.plan_files").get_template("plan.html")
    return page(
        title,
        body.render(
            title=title,
            summary=_summary(files, objects),
            about=f"{gripper.name}, opening up to {1e3 * gripper.stroke:.0f} mm, planned by {planner}.",
            command=command,
            files=files,
            score_rgb=score_rgb,
            position=_position,
            pose=_pose,
            remarks=_remarks,
            left_out=left_out,
            up_of=up_of,
            scene_figure=scene_figure,
            object_figure=object_figure,
        ),
        style=(package_files("grasping.plan_files") / "page.css").read_text(encoding="utf-8"),
    )


def _summary(files: Sequence[PlannedFile], objects: Sequence[PlannedObject]) -> str:
    graspable = sum(each.plan.best is not None for each in objects)
    failed = sum(file.failed for file in files)
    failures = f"; {failed} file{'s' * (failed > 1)} failed" if failed else ""
    return f"{graspable} of {len(objects)} objects can be grasped{failures}."


def _position(grasp: Grasp) -> str:
    return " ".join(f"{value:.3f}" for value in grasp.pose[:3, 3].round(3) + 0.0)  # no -0.000


def _pose(grasp: Grasp) -> str:
    return "\n".join(" ".join(f"{value:9.5f}" for value in row) for row in grasp.pose)


def _remarks(each: PlannedObject) -> list[str]:
    """What is said below an object's heading."""
    best = each.plan.best
    remarks = [f"{len(each.points):,} points", f"planned in {1e3 * each.plan_s:.1f} ms", *each.remarks]
    if best is not None:
        width = f"width {1e3 * best.width:.0f} mm, score {best.score:.2f}"
        remarks.insert(0, f"best of {len(each.plan.candidates)}: {width}")
    return remarks


def _layer(each: PlannedObject, grasp: Grasp | None = None) -> Layer:
    """An object in the colour of its score. grasp: drawn with it."""
    best = each.plan.best
    if best is None:
        return Layer(each.points, each.name, (f"no grasp: {each.plan.reason}",), _GRASPS, score_rgb(None))
    primitive = "" if best.region is None else f", {each.plan.regions[best.region].primitive}"
    details = (f"score {best.score:.2f}, {best.kind}{primitive}", f"width {1e3 * best.width:.0f} mm")
    return Layer(each.points, each.name, details, _GRASPS, score_rgb(best.score), grasp)
