"""A corner that the sensor bends rises little by little, the thinnest sheet by an edge."""

import numpy as np
import pytest

from grasping import Segmenter
from tests.grasping.rendered_scenes import look_down, owners_of, render, up_in


def with_bent_corner(frame: np.ndarray, most: float) -> np.ndarray:
    """The frame as a lens shows it that brings its lower right corner nearer, in the end by so much (1/m)."""
    h, w = frame.shape[:2]
    into = np.clip(np.linspace(0, 1, w) + np.linspace(0, 1, h)[:, None] - 1.8, 0, None) / 0.2
    q = 1 / frame[..., 2].astype(np.float64) + most * into**1.5
    return (frame / (frame[..., 2:] * q[..., None])).astype(np.float32)


@pytest.mark.parametrize("most", [0.02, 0.03])
@pytest.mark.parametrize("sheet", [0.005, 0.008])
def test_a_bent_corner_of_the_table_is_no_thing_and_a_sheet_is_one(most: float, sheet: float) -> None:
    T = look_down(10.0, 0.7)
    frame, owner = render([(0.0, 0.0, 0.12, 0.16, sheet)], T, 0.0008)
    scene = Segmenter().segment(with_bent_corner(frame, most), up=up_in(T))
    (shares,) = owners_of(scene, owner)
    assert shares[0] > 0.9
    assert not scene.obstacles
