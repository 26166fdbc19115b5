"""Training clouds out of heaps: cut out by the robot's segmenter, labelled by what most of each lies on."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, TabletopConfig
from pecgrasp_env.capture.scenarios import open_scenario
from pecgrasp_env.capture.scenarios.base import Subject
from pecgrasp_env.capture.shard_plan import allot, open_source
from pecgrasp_env.objects import UNKNOWN, make_object

HEAP = CaptureConfig(
    scenario="piled",
    objects=ObjectsConfig(classes=("box", "can"), instances_per_class=1),
    sensor="d435",
    tabletop=TabletopConfig(objects_per_frame=2, min_purity=0.5),
    max_occlusion=0.9,
    seed=1,
)


@pytest.fixture(scope="module")
def subjects():
    return [Subject(make_object(name, 0), i, i) for i, name in enumerate(("box", "can"))]


def test_clouds_of_a_heap_are_labelled_by_the_majority_and_the_same_for_one_seed(subjects):
    captured = open_scenario(HEAP, 1).capture(subjects, 0, 1)
    assert captured.given_up == {}
    assert [sample.class_index for sample in captured.samples] == [0, 1]
    assert all(0.5 <= sample.purity <= 1 for sample in captured.samples)
    again = open_scenario(HEAP, 1).capture(subjects, 0, 1)
    for one, other in zip(captured.samples, again.samples, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_a_heap_has_its_own_usual_numbers():
    settings = {
        "objects": {"classes": None, "source": "catalogue", "path": None, "scale": 1.0, "allow_open": False, "seed": 0,
                    "download": False},
        "instances_per_class": None,
        "sensor": {"mode": "d435", "resolution": "424x240"},
        "tabletop": {"objects_per_frame": None, "min_purity": None, "drops": 4},
    }  # fmt: skip
    heap = CaptureConfig.from_settings(settings | {"scenario": "piled"}).tabletop
    apart = CaptureConfig.from_settings(settings | {"scenario": "tabletop"}).tabletop
    assert (heap.objects_per_frame, heap.min_purity, heap.drops) == (6, 0.5, 4)
    assert (apart.objects_per_frame, apart.min_purity, apart.drops) == (3, 0.95, 4)


def within(sample, model) -> float:
    """The share of a cloud that lies where its object does, by its box."""
    own = (sample.points - sample.T_camera_object[:3, 3]) @ sample.T_camera_object[:3, :3]
    corners = np.concatenate([part.vertices for part in model.parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return float(((own > low - 0.01) & (own < high + 0.01)).all(axis=1).mean())


def test_known_things_are_cut_out_whole_and_some_strangers_are_what_was_cut_wrongly(subjects):
    stranger = replace(make_object("mug", 0), class_name=UNKNOWN)
    among = [*subjects, Subject(stranger, 2, 2)]
    heap = replace(HEAP, tabletop=replace(HEAP.tabletop, objects_per_frame=3))
    samples = open_scenario(heap, 1).capture(among, 0, 12).samples
    shares = [[within(s, subject.model) for s in samples if s.class_index == i] for i, subject in enumerate(among)]
    assert min(shares[0] + shares[1]) > 0.75
    assert len(shares[2]) == 12
    assert 2 <= sum(share < 0.75 for share in shares[2]) <= 10


def test_the_same_things_lie_in_a_heap_and_apart(subjects):
    captured = open_scenario(HEAP, 1).capture(subjects, 0, 24)
    seen: dict[int, dict[int, np.ndarray]] = {}
    for sample in captured.samples:
        seen.setdefault(sample.seed, {})[sample.class_index] = sample.T_camera_object
    between = [np.linalg.inv(pair[0]) @ pair[1] for pair in seen.values() if len(pair) == 2]
    layouts = Counter(tuple(T[:3, 3].round(3)) for T in between)
    assert len(layouts) > 1
    assert max(layouts.values()) > 2  # looks at one heap
    assert min(layouts.values()) == 1  # those apart are laid anew for each look


def test_strangers_lie_among_the_known_things_of_heaps():
    config = replace(
        HEAP,
        objects=replace(HEAP.objects, instances_per_class=4, strangers=4),
        samples_per_instance=3,
        tabletop=replace(HEAP.tabletop, objects_per_frame=6),
    )
    source = open_source(config)
    _, jobs = allot(config, source)
    kinds = [{source.classes[member.class_index] == UNKNOWN for member in job.members} for job in jobs]
    assert sum(len(job.members) * job.count for job in jobs) == (8 + 4) * 3
    assert {True, False} in kinds
