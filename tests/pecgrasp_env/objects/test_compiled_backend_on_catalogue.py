"""The compiled planner and its NumPy reference on every class of the catalogue, seen whole and from one side."""

import numpy as np
import pytest

import grasping
from grasping import CurvaturePlanner
from pecgrasp_env.objects import LARS_CLASSES, make_object


@pytest.mark.skipif(not grasping.compiled, reason="this installation has no compiled kernels")
@pytest.mark.parametrize("name", LARS_CLASSES)
def test_plans_are_identical(name: str) -> None:
    cloud = np.asarray(make_object(name, 0).visual_mesh().sample(1500, seed=0), float)
    cloud[:, 2] -= cloud[:, 2].min()
    toward_camera = (cloud - cloud.mean(axis=0)) @ [0.6, 0.0, 0.8]
    for seen in (cloud, cloud[toward_camera > np.quantile(toward_camera, 0.5)].astype(np.float32)):
        fast, slow = (
            CurvaturePlanner(compiled=compiled).plan(seen, up=(0, 0, 1), table=(0, 0, 1, 0))
            for compiled in (True, False)
        )
        assert fast.reason == slow.reason
        assert [grasp.terms for grasp in fast.candidates] == [grasp.terms for grasp in slow.candidates]
        for one, other in zip(fast.candidates, slow.candidates, strict=True):
            np.testing.assert_array_equal(one.pose, other.pose)
        assert [region.curvature for region in fast.regions] == [region.curvature for region in slow.regions]
