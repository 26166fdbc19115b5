"""What a scene was left without, what to type to have it, and which cuts are not sure: lines for people."""

from __future__ import annotations

from itertools import groupby

from grasping.segmentation.scene import Cut, Rejected, Scene

# Settings of the command; every other one is the segmenter's.
OF_COMMAND = ("frame", "up", "scale")
SURE = 0.9  # a cut that is less sure is named


def left_out(scene: Scene) -> list[str]:
    """A line for each cut that is not sure, for each kind of thing that was left out and could be wanted, the largest
    first, then of planes and of the rest.
    """
    lines = [of_cut(cut) for cut in unsure_cuts(scene)]
    lines += [_plane(each, scene) for each in scene.rejected if each.what == "plane" and each.way_out]
    wanted, rest = kinds_left_out(scene)
    lines += [of_kind(kind) for kind in wanted]
    if scene.plane is not None:
        planes = [each for each in scene.rejected if each.what == "plane" and not each.way_out]
        lines += [f"another plane of {each.n_points:,} points: {each.why}" for each in planes]
    if rest:
        lines.append("left out: points " + ", ".join(f"{each.n_points:,} {each.why}" for each in rest))
    return lines


def kinds_left_out(scene: Scene) -> tuple[list[list[Rejected]], list[Rejected]]:
    """What was left out and could be wanted, by its kind, the largest first; and the other points."""
    wanted = [each for each in scene.rejected if each.what != "plane" and (each.way_out or each.what == "cluster")]
    kinds = [list(kind) for _, kind in groupby(sorted(wanted, key=_kind), key=_kind)]
    rest = [each for each in scene.rejected if each.what == "points" and not each.way_out]
    return sorted(kinds, key=lambda kind: -sum(each.n_points for each in kind)), rest


def of_kind(kind: list[Rejected]) -> str:
    """What things of one kind are, and what to type to have them."""
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


def unsure_cuts(scene: Scene) -> list[Cut]:
    """The cuts between neighbours that another view could undo, the least sure first."""
    return sorted((cut for cut in scene.cuts if cut.sure < SURE), key=lambda cut: cut.sure)


def of_cut(cut: Cut) -> str:
    return f"object {cut.first + 1} and object {cut.second + 1} adjoin, and are two with {100 * cut.sure:.0f} %"


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
