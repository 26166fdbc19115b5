"""The page that planning on files leaves: a table, and for each scene and each object a figure to turn around."""

from __future__ import annotations

import html
from collections.abc import Sequence
from importlib.resources import files as package_files

import numpy as np
from numpy.typing import ArrayLike

from grasping.gripper import Gripper
from grasping.plan_files.results import PlannedFile, PlannedObject
from grasping.viewer.figure import Layer, fragment, score_rgb
from grasping.viewer.html import page

_ALL_POINTS = 400_000  # of all figures together: 3.5 MB


def plan_page(
    files: Sequence[PlannedFile], gripper: Gripper, planner: str, up: ArrayLike | None = None, command: str = ""
) -> str:
    """A self-contained HTML document. up: as it was given to the planner; where it was not, a scene's table says it."""
    style = (package_files("grasping.plan_files") / "page.css").read_text(encoding="utf-8")
    objects = [each for file in files for each in file.objects]
    held = sum(each.plan.best is not None for each in objects)
    title = f"Grasps on {files[0].path.name}" if len(files) == 1 else f"Grasps on {len(files)} clouds"
    failed = sum(file.failed for file in files)
    told = (
        f"{held} of {len(objects)} objects can be grasped"
        + (f"; {failed} file{'s' * (failed > 1)} failed" if failed else "")
        + "."
    )
    about = f"{gripper.name}, opening up to {1e3 * gripper.stroke:.0f} mm, planned by {planner}."
    figures = len(objects) + sum(file.scene is not None for file in files)
    budget = int(np.clip(_ALL_POINTS // max(1, figures), 1500, 20_000))
    body = [
        f"<header><h1>{_esc(title)}</h1>",
        f"<p>{_esc(told)} {_esc(about)} Poses are in the frame of each cloud, metres.</p>",
        f"<pre>{_esc(command)}</pre>" if command else "",
        "</header>",
        _table(files),
        *(_section(k, file, gripper, up, budget) for k, file in enumerate(files)),
    ]
    return page(title, "\n".join(body), style=style)


def _table(files: Sequence[PlannedFile]) -> str:
    head = '<th>cloud</th><th class="right">points</th><th class="right">width</th><th class="right">score</th>'
    head += '<th>kind</th><th>position</th><th class="right">time</th>'
    rows = []
    for k, file in enumerate(files):
        link = f'<a href="#cloud-{k}">{_esc(file.path.name)}</a>'
        points = "" if file.n_points is None else f"{file.n_points:,}"
        start = f'<td class="name">{link}</td><td class="right">{points}</td>'
        if file.error is not None:
            rows.append(f'<tr>{start}<td class="bad" colspan="5">{_esc(file.error)}</td></tr>')
        elif file.scene is not None:
            found = file.found
            time = f'<td class="right">{1e3 * file.segment_s:.1f} ms</td>'
            rows.append(f'<tr>{start}<td colspan="4">{_esc(found)}</td>{time}</tr>')
            rows += [_row(each, f"#cloud-{k}-{i}", "inner") for i, each in enumerate(file.objects)]
        else:
            rows += [_row(each, f"#cloud-{k}", "") for each in file.objects]
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def _row(each: PlannedObject, address: str, kind: str) -> str:
    cells = (
        f'<td class="name"><a href="{address}">{_esc(each.name)}</a></td><td class="right">{len(each.points):,}</td>'
    )
    best = each.plan.best
    if best is None:
        tone = "bad" if each.error else "no"
        cells += f'<td class="{tone}" colspan="4">{_esc(each.plan.reason)}</td>'
    else:
        colour = f'<i style="background:rgb{score_rgb(best.score)}"></i>'
        position = " ".join(f"{value:.3f}" for value in best.pose[:3, 3].round(3) + 0.0)  # no -0.000
        cells += f'<td class="right">{1e3 * best.width:.0f} mm</td><td class="right">{colour}{best.score:.2f}</td>'
        cells += f"<td>{best.kind}</td><td>{position}</td>"
    return f'<tr class="{kind}">{cells}<td class="right">{1e3 * each.plan_s:.1f} ms</td></tr>'


def _section(k: int, file: PlannedFile, gripper: Gripper, up: ArrayLike | None, budget: int) -> str:
    head = f'<section id="cloud-{k}"><h2>{_esc(file.path.name)}</h2>'
    if file.error is not None:
        return f'{head}<p class="bad">{_esc(file.error)}</p></section>'
    if file.scene is None:
        return head + "".join(_object(each, gripper, up, budget) for each in file.objects) + "</section>"
    upward = up if up is not None or file.scene.plane is None else file.scene.plane[:3]
    layers = [
        Layer(each.points, each.name, _details(each), "Objects", score_rgb(_score(each)), each.plan.best)
        for each in file.objects
    ]
    overview = ""
    if file.n_points:
        overview = fragment(cloud=file.rest, gripper=gripper, layers=layers, up=_vector(upward), max_points=2 * budget)
    table = "No table was found" if file.scene.plane is None else "What stands on the table that was found"
    parts = [f"{head}<p>{table}; left out: {_esc(file.scene.summary())}.</p>{overview}</section>"]
    for i, each in enumerate(file.objects):
        title = f'<section id="cloud-{k}-{i}"><h3>{_esc(each.name)} of {_esc(file.path.name)}</h3>'
        parts.append(title + _object(each, gripper, upward, budget) + "</section>")
    return "\n".join(parts)


def _object(each: PlannedObject, gripper: Gripper, up: ArrayLike | None, budget: int) -> str:
    best = each.plan.best
    told = [f"{len(each.points):,} points", f"planned in {1e3 * each.plan_s:.1f} ms"]
    told += each.remarks
    pose = ""
    if best is None:
        tone = "bad" if each.error else "no"
        first = f'<p class="{tone}">No grasp: {_esc(each.plan.reason)}</p>'
    else:
        first = ""
        told.insert(0, f"best of {len(each.plan.candidates)}: width {1e3 * best.width:.0f} mm, score {best.score:.2f}")
        rows = "\n".join(" ".join(f"{value:9.5f}" for value in row) for row in best.pose)
        pose = f"<details><summary>pose of the best grasp</summary><pre>{rows}</pre></details>"
    figure = ""
    if len(each.points):
        layers = (
            [] if each.plan.regions else [Layer(each.points, each.name, _details(each), rgb=score_rgb(_score(each)))]
        )
        figure = fragment(
            each.plan,
            each.surroundings,
            gripper=gripper,
            layers=layers,
            up=_vector(up),
            max_points=budget,
        )
    return f"{first}<p>{_esc(' · '.join(told))}</p>{figure}{pose}"


def _details(each: PlannedObject) -> tuple[str, ...]:
    best = each.plan.best
    if best is None:
        return (f"no grasp: {each.plan.reason}",)
    primitive = "" if best.region is None else f", {each.plan.regions[best.region].primitive}"
    return (f"score {best.score:.2f}, {best.kind}{primitive}", f"width {1e3 * best.width:.0f} mm")


def _score(each: PlannedObject) -> float | None:
    return None if each.plan.best is None else each.plan.best.score


def _vector(up: ArrayLike | None) -> np.ndarray | None:
    return None if up is None else np.asarray(up, dtype=np.float64)


def _esc(text: object) -> str:
    return html.escape(str(text))
