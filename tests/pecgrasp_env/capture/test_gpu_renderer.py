"""ManiSkill's batch against the renderer of single objects, with one sub-scene on the CPU: every machine has that."""

import hashlib
import multiprocessing
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig, TabletopConfig, generate
from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, gpu_draws
from pecgrasp_env.capture.rendering.gpu_renderer import GpuRenderer
from pecgrasp_env.capture.scenarios import open_scenario
from pecgrasp_env.capture.scenarios.base import Captured, Subject
from pecgrasp_env.capture.scenarios.free import FreeScenario
from pecgrasp_env.capture.scenarios.tabletop import TabletopScenario
from pecgrasp_env.objects import make_object

# SAPIEN draws on the device of a process's first renderer, so each comparison has a process of its own.
APART = multiprocessing.get_context("forkserver")
APART.set_forkserver_preload(["pecgrasp_env.capture.rendering.gpu_renderer", "pecgrasp_env.capture.scenarios.tabletop"])

FREE = CaptureConfig(sensor="d435", resolutions=("424x240", "848x480"))
TABLETOP = CaptureConfig(scenario="tabletop", sensor="d435", tabletop=TabletopConfig(drops=6))


def in_a_process(routine, *arguments):
    with APART.Pool(1) as pool:
        return pool.apply(routine, arguments)


def both_ways(config: CaptureConfig) -> list[tuple[Captured, Captured]]:
    warnings.simplefilter("error", UserWarning)  # nobody takes over
    scenario = TabletopScenario if config.scenario == "tabletop" else FreeScenario
    batch = scenario(config, partial(GpuRenderer, cameras=config.intrinsics, at_once=1, device="cpu"))
    alone = scenario(config)
    sets = (
        [[("stapler", 0)], [("can", 1)]] if config.scenario == "free" else [[("stapler", 0), ("can", 1)], [("mug", 0)]]
    )
    made = []
    for names in sets:
        subjects = [Subject(make_object(*name), i, i) for i, name in enumerate(names)]
        made.append((alone.capture(subjects, 0, 6), batch.capture(subjects, 0, 6)))
    return made


@pytest.mark.parametrize("config", [FREE, TABLETOP], ids=["free", "tabletop"])
def test_labels_poses_and_rejections_are_those_of_single_frames_and_clouds_differ_by_rounding(config):
    for alone, batch in in_a_process(both_ways, config):
        assert batch.rejected == alone.rejected
        assert len(batch.samples) == len(alone.samples) >= 6
        for ours, theirs in zip(batch.samples, alone.samples, strict=True):
            for name in ("class_index", "instance_index", "camera", "seed"):
                assert getattr(ours, name) == getattr(theirs, name)
            assert np.array_equal(ours.T_camera_object, theirs.T_camera_object)
            assert ours.occlusion == pytest.approx(theirs.occlusion, abs=0.02)
            assert len(ours.points) == pytest.approx(len(theirs.points), rel=0.03, abs=3)
            if len(ours.points) == len(theirs.points):
                # The sensor counts in millimetres: rounding may fall to the other side.
                assert np.mean(np.abs(ours.points - theirs.points).max(axis=1) < 1.1e-3) > 0.97


class Askew(DepthRenderer):
    """A renderer that draws everything too near."""

    def render(self, shot):
        frame = super().render(shot)
        return type(frame)(frame.depth * np.float32(0.99), frame.intrinsics)


def with_another_renderer() -> tuple[list[str], Captured, Captured]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pecgrasp_env.capture.rendering.gpu_renderer.DepthRenderer", Askew)
        batch = FreeScenario(FREE, partial(GpuRenderer, cameras=FREE.intrinsics, at_once=1, device="cpu"))
    subjects = [Subject(make_object("stapler", 0), 0, 0)]
    with warnings.catch_warnings(record=True) as messages:
        made = batch.capture(subjects, 0, 3)
    return [str(each.message) for each in messages], made, FreeScenario(FREE, Askew).capture(subjects, 0, 3)


def test_a_batch_that_draws_something_else_is_left_with_a_warning():
    messages, made, singles = in_a_process(with_another_renderer)
    assert any("ManiSkill's batch is not used: its first frame is another" in line for line in messages)
    for ours, theirs in zip(made.samples, singles.samples, strict=True):
        assert np.array_equal(ours.points, theirs.points)


def renderer_of(frames_at_once: int | None) -> tuple[type, int]:
    renderer = open_scenario(FREE, frames_at_once)._renderer
    return type(renderer), renderer.at_once


@pytest.mark.skipif(gpu_draws(), reason="this machine has a GPU")
def test_without_a_gpu_frames_are_drawn_one_by_one():
    assert in_a_process(renderer_of, None) == (DepthRenderer, 1)
    assert in_a_process(renderer_of, 1) == (DepthRenderer, 1)


@pytest.mark.skipif(gpu_draws(), reason="this machine has a GPU")
@pytest.mark.parametrize("scenario", ["free", "tabletop"])
def test_a_batch_that_is_asked_for_where_there_is_no_gpu_gives_way_to_the_same_bytes(tmp_path, scenario):
    config = CaptureConfig(
        scenario=scenario,
        objects=ObjectsConfig(classes=("can", "stapler"), instances_per_class=1),
        samples_per_instance=5,
        tabletop=TabletopConfig(drops=4),
    )
    one = generate(config, tmp_path / "one", workers=1).directory
    with pytest.warns(UserWarning, match="ManiSkill's batch is not used: failed to find device"):
        asked = generate(config, tmp_path / "asked", workers=1, frames_at_once=8).directory
    assert digests(one) == digests(asked)


def digests(directory: Path) -> list[str]:
    return [hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(directory.rglob("*.*"))]


@pytest.mark.parametrize("scenario", ["free", "tabletop"])
def test_samples_do_not_depend_on_how_many_frames_are_drawn_ahead(scenario):
    config = CaptureConfig(scenario=scenario, sensor="d435", tabletop=TabletopConfig(drops=4))

    class Several(DepthRenderer):
        at_once = 5

    kind = TabletopScenario if scenario == "tabletop" else FreeScenario
    subjects = [Subject(make_object(name, 0), i, i) for i, name in enumerate(("can", "stapler"))]
    one, several = (kind(config, renderer).capture(subjects, 0, 7) for renderer in (DepthRenderer, Several))
    assert one.rejected == several.rejected
    assert len(one.samples) == 14
    for ours, theirs in zip(several.samples, one.samples, strict=True):
        assert np.array_equal(ours.points, theirs.points)
        assert ours.seed == theirs.seed


def test_frames_at_once_is_a_number_of_frames(tmp_path):
    with pytest.raises(CaptureError, match="frames_at_once must be at least 1, or null"):
        generate(FREE, tmp_path, frames_at_once=0)
