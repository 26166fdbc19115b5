"""Training clouds out of heaps: cut out by the robot's segmenter, labelled by what most of each lies on."""

import numpy as np
import pytest

from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, TabletopConfig
from pecgrasp_env.capture.scenarios import open_scenario
from pecgrasp_env.capture.scenarios.base import Subject
from pecgrasp_env.objects import make_object

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


def test_one_heap_is_looked_at_from_many_places(subjects):
    captured = open_scenario(HEAP, 1).capture(subjects, 0, 3)
    boxes, cans = ([sample.T_camera_object for sample in captured.samples if sample.class_index == i] for i in range(2))
    between = [np.linalg.inv(box) @ can for box, can in zip(boxes, cans, strict=True)]
    np.testing.assert_allclose(between, between[:1] * 3, atol=1e-5)  # all of one heap
    assert len({tuple(box[:3, 3].round(4)) for box in boxes}) == 3  # and no look is another's
    more = open_scenario(HEAP, 1).capture(subjects, 0, 3)
    np.testing.assert_array_equal(captured.samples[-1].points, more.samples[-1].points)


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
