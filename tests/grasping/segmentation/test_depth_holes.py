"""A stripe without depth does not make two things of one; two things with nothing measured behind them stay two."""

import numpy as np
import pytest
from rendered_scenes import look_down, render, up_in

from grasping import Segmenter


@pytest.mark.parametrize("upright", [True, False])
def test_a_stripe_without_depth_leaves_one_thing(upright: bool) -> None:
    T = look_down(75.0, 0.6)  # from low over the table
    frame, owner = render([(0.0, 0.0, 0.09, 0.09, 0.16)], T, 0.0005)
    row, column = np.nonzero(owner == 0)
    middle = int(np.median(column if upright else row))
    stripe = np.zeros(owner.shape, bool)
    (stripe.T if upright else stripe)[middle - 9 : middle + 9] = True
    frame[stripe & (owner == 0)] = np.nan
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == 1
    shown = np.zeros(owner.shape, bool).reshape(-1)
    shown[scene.indices[0]] = True
    measured = (owner == 0) & np.isfinite(frame[..., 2])
    assert shown[measured.reshape(-1)].mean() > 0.95


@pytest.mark.parametrize("gap", [0.02, 0.03, 0.045])
def test_two_things_side_by_side_against_nothing_stay_two(gap: float) -> None:
    T = look_down(75.0, 0.6)
    boxes = [(side * (0.03 + gap / 2), 0.0, 0.06, 0.06, 0.16) for side in (-1, 1)]
    frame, owner = render(boxes, T, 0.0005)
    frame[(owner < 0) & (np.indices(owner.shape)[0] < np.nonzero(owner >= 0)[0].min() + 60)] = np.nan
    assert len(Segmenter().segment(frame, up=up_in(T)).objects) == 2
