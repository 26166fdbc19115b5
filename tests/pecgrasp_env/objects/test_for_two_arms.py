"""Long and heavy things: what a seed draws, and that it lies still on a table."""

import numpy as np
import pytest

from pecgrasp_env.objects import CLASSES, ObjectError
from pecgrasp_env.objects.procedural.for_two_arms.draw import KINDS, draw_large
from pecgrasp_env.scene.settling import settle


@pytest.mark.parametrize("kind", KINDS)
def test_they_are_long_heavy_and_rest(kind):
    assert kind not in CLASSES
    for seed in range(6):
        model = draw_large(kind, seed)
        assert 1.0 <= model.mass <= 6.0
        assert 0.38 <= model.extents[0] <= 0.85
        assert model.extents[0] > model.extents[1] > 0.02
        lowest = min(float(hull[:, 2].min()) for hull in model.hulls)
        start = np.array([[0.0, 0.0, 0.005 - lowest, 1.0, 0.0, 0.0, 0.0]])
        end, at_rest = settle([model], start)
        assert at_rest.all()
        assert abs(end[0, 3]) > 0.999  # as it was put down


def test_a_seed_draws_the_same_again_and_another_one_another():
    one, same, other = draw_large("board", 3), draw_large("board", 3), draw_large("board", 4)
    assert one.mass == same.mass != other.mass
    assert all(np.array_equal(a, b) for a, b in zip(one.hulls, same.hulls, strict=True))


def test_what_is_not_there_is_named():
    with pytest.raises(ObjectError, match="kind='plank'"):
        draw_large("plank", 0)
    with pytest.raises(ObjectError, match="seed=-1"):
        draw_large("board", -1)
