"""Files that were planned on, as rows of a table for people."""

from __future__ import annotations

from grasping.plan_files.left_out import left_out
from grasping.plan_files.results import PlannedFile


def table_lines(file: PlannedFile) -> list[str]:
    """The file's rows of the table for people."""
    if file.error is not None:
        return [_line(file.path.name, _count(file.n_points)) + f"  error: {file.error}"]
    lines = []
    if file.scene is not None:
        lines.append(_line(file.path.name, _count(file.n_points)) + f"  {file.found}, {1e3 * file.segment_s:.1f} ms")
        lines += [f"  {each}" for each in left_out(file.scene)]
    for each in file.objects:
        name = f"  {each.name}" if file.scene is not None else each.name
        ms, best = f"{1e3 * each.plan_s:.1f} ms", each.plan.best
        if best is None:
            word = "error" if each.error else "no grasp"
            start = _line(name, f"{len(each.points):,}")
            lines.append("  ".join([start, f"{word}: {each.plan.reason}, {ms}", *each.remarks]))
            continue
        position = " ".join(f"{value:6.3f}" for value in best.pose[:3, 3].round(3) + 0.0)  # no -0.000
        row = (f"{len(each.points):,}", f"{1e3 * best.width:.0f} mm", f"{best.score:.2f}", best.kind, position, ms)
        lines.append("  ".join([_line(name, *row), *each.remarks]))
    return lines


def _count(n_points: int | None) -> str:
    return "" if n_points is None else f"{n_points:,}"


def _line(
    name: str, points: str = "", width: str = "", score: str = "", kind: str = "", position: str = "", ms: str = ""
) -> str:
    name = name if len(name) <= 28 else "…" + name[-27:]
    return f"{name:28} {points:>9} {width:>7} {score:>6}  {kind:9} {position:>20} {ms:>8}".rstrip()


HEADER = _line("cloud", "points", "width", "score", "kind", "position m", "time")
