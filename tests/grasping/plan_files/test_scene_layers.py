"""The picture of a scene: each object, the table, what was left out and why, in colours with a legend that says it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grasping_shapes import box_top, moved
from table_scenes import box, on_a_table, task

from grasping import Cut, Scene, Segmenter
from grasping.plan_files.left_out import left_out
from grasping.plan_files.run import plan_files
from grasping.plan_files.scene_layers import scene_layers

SCENE = on_a_table(
    moved(box(), y=0.15),
    moved(box(), y=0.21),
    moved(box_top(0.52, 0.06, 0.08), y=-0.1),
    moved(box_top(0.06, 0.06, 0.006), x=0.2, y=0.2),
)


class Doubtful(Segmenter):
    """Tells two halves of the largest object apart and is not sure of it."""

    def segment(self, cloud, **how) -> Scene:
        scene = super().segment(cloud, **how)
        index, *rest = scene.indices
        left = np.asarray(cloud).reshape(-1, 3)[index, 1] < np.median(np.asarray(cloud).reshape(-1, 3)[index, 1])
        halves = [index[left], index[~left]]
        extra = len(scene.objects)
        return replace(
            scene,
            indices=[*halves, *rest],
            objects=[np.asarray(cloud).reshape(-1, 3)[each] for each in [*halves, *rest]],
            touches_border=[False] * (extra + 1),
            touches_gripper=[False] * (extra + 1),
            unseen=[np.empty((0, 3))] * (extra + 1),
            confidence=[0.5] + [0.99] * extra,
            cuts=[Cut(0, 1, 0.55)],
        )


def test_every_point_is_drawn_once_and_the_legend_says_why_it_was_left_out() -> None:
    scene = Segmenter(min_height=0.01).segment(SCENE)
    layers = scene_layers(SCENE, scene)
    drawn = np.concatenate([layer.points for layer in layers])
    np.testing.assert_array_equal(drawn[np.lexsort(drawn.T)], SCENE[np.lexsort(SCENE.T)])
    assert len({layer.rgb for layer in layers}) == len(layers)
    labels = {layer.label: layer for layer in layers}
    (large,) = [label for label in labels if "0.52 m large" in label]
    (cluster,) = [each for each in scene.rejected if "large" in each.why]
    assert large == (
        f"left out: {cluster.n_points:,} points in 1 cluster: 0.52 m large, more than 0.45 m; "
        "+segmenter.max_extent=0.55 takes them"
    )
    assert labels[large].details == ("the gripper keeps clear of 1 of 1",)
    (low,) = [label for label in labels if "mm high" in label]
    assert "+segmenter.min_height=" in low
    assert labels[low].details == ()  # no finger can hit it
    assert f"table, {scene.n_table:,} points" in labels
    assert [label for label in labels if label.startswith("object")] == [
        f"object {k + 1}" for k in range(len(scene.objects))
    ]
    assert {layer.label for layer in layers if layer.framed} == {f"object {k + 1}" for k in range(len(scene.objects))}


def test_pixels_without_depth_are_not_drawn() -> None:
    cloud = np.concatenate([SCENE, np.full((50, 3), np.nan), np.zeros((50, 3))])
    layers = scene_layers(cloud, Segmenter().segment(cloud))
    assert sum(len(layer.points) for layer in layers) == len(SCENE)
    assert not any("no depth" in layer.label for layer in layers)


def test_a_scene_without_a_table_is_drawn() -> None:
    cloud = moved(box(), z=0.5)
    labels = [layer.label for layer in scene_layers(cloud, Segmenter().segment(cloud))]
    assert labels == ["object 1"]


def test_a_cut_that_is_not_sure_is_drawn_where_it_is() -> None:
    scene = Doubtful().segment(SCENE)
    first, *_ = scene_layers(SCENE, scene)
    assert first.label == "not sure: object 1 and object 2 adjoin, and are two with 55 %"
    between = np.mean([scene.objects[0][:, 1].max(), scene.objects[1][:, 1].min()])
    assert 10 < len(first.points) < 0.6 * (len(scene.objects[0]) + len(scene.objects[1]))
    assert np.abs(first.points[:, 1] - between).max() < 0.02
    sure = replace(scene, cuts=[Cut(0, 1, 0.97)])
    assert scene_layers(SCENE, sure)[0].label == "object 1"
    assert not any("adjoin" in line for line in left_out(sure))


def test_what_is_not_sure_is_said_everywhere(tmp_path: Path, browse) -> None:
    np.save(tmp_path / "frame.npy", SCENE)
    said: list[str] = []
    plan_files([tmp_path / "frame.npy"], task(segmenter=Doubtful(), up=None), tmp_path, say=said.append)
    assert "  object 1 and object 2 adjoin, and are two with 55 %" in said
    (row,) = [line for line in said if line.startswith("  object 1  ")]
    assert row.endswith("one thing with 50 %")
    (file,) = json.loads((tmp_path / "results.json").read_text())["files"]
    assert file["cuts"] == [{"first": 0, "second": 1, "sure": 0.55}]
    assert file["objects"][0]["confidence"] == 0.5
    page = browse((tmp_path / "plan.html").read_text())
    legend = page.run("document.querySelector('[data-legend=Objects]').innerText")
    assert "not sure: object 1 and object 2 adjoin, and are two with 55 %" in legend
    assert "0.52 m large, more than 0.45 m; +segmenter.max_extent=0.55 takes them" in legend
    assert page.run("document.querySelector('[data-legend=Grasps]').hidden")
    assert page.run("document.documentElement.scrollWidth <= innerWidth")
    assert page.console == []


@pytest.mark.parametrize("segmenter", [Segmenter(), Segmenter.published()])
def test_every_segmenter_says_which_points_it_left_out(segmenter) -> None:
    scene = segmenter.segment(SCENE)
    known = np.concatenate([*scene.indices, *(each.indices for each in scene.rejected)])
    assert len(np.unique(known)) == len(known) == len(SCENE) - scene.n_table
    assert all(len(each.indices) == each.n_points for each in scene.rejected if each.what != "plane")
