"""What a scene was left without, and what to type to have it: lines for people."""

from __future__ import annotations

from itertools import groupby

from grasping.segmentation.scene import Rejected, Scene

# Settings of the command; every other one is the segmenter's.
OF_COMMAND = ("frame", "up", "scale")


def left_out(scene: Scene) -> list[str]:
    """A line for each kind of thing that was left out and could be wanted, the largest first, then of planes and of the
    rest.
    """
    wanted = [each for each in scene.rejected if each.what != "plane" and (each.way_out or each.what == "cluster")]
    kinds = [list(kind) for _, kind in groupby(sorted(wanted, key=_kind), key=_kind)]
    lines = [_plane(each, scene) for each in scene.rejected if each.what == "plane" and each.way_out]
    lines += [_line(kind) for kind in sorted(kinds, key=lambda kind: -sum(each.n_points for each in kind))]
    if scene.plane is not None:
        planes = [each for each in scene.rejected if each.what == "plane" and not each.way_out]
        lines += [f"another plane of {each.n_points:,} points: {each.why}" for each in planes]
    rest = [each for each in scene.rejected if each.what == "points" and not each.way_out]
    if rest:
        lines.append("left out: points " + ", ".join(f"{each.n_points:,} {each.why}" for each in rest))
    return lines


def typed(way_out: str) -> str:
    """A way out as it is typed on the command line."""
    setting = way_out if way_out.split("=")[0] in OF_COMMAND else f"+segmenter.{way_out}"
    return f"'{setting}'" if "[" in setting else setting


def _kind(each: Rejected) -> tuple[str, str]:
    return each.what, each.way_out.split("=")[0] or each.why


def _plane(each: Rejected, scene: Scene) -> str:
    if scene.plane is None:
        return f"no table: {each.why}; say another {typed(each.way_out)}, or neither up nor frame=world"
    return f"{each.why}; say {typed(each.way_out)}"


def _line(kind: list[Rejected]) -> str:
    largest = max(kind, key=lambda each: each.n_points)
    count = sum(each.n_points for each in kind)
    what = f"left out: {count:,} points"
    if largest.what == "cluster":
        what += f" in {len(kind)} cluster{'s' * (len(kind) > 1)}"
    more = " at the most" if len(kind) > 1 and largest.way_out.startswith("max") else ""
    if not largest.way_out:
        return f"{what}: {largest.why}, of which the camera must see more; 'up=[x,y,z]' if it is another plane"
    verb = "says where up is" if largest.way_out.split("=")[0] in ("frame", "up") else "takes them"
    return f"{what}: {largest.why}{more}; {typed(largest.way_out)} {verb}"
