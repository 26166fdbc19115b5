"""What stands out of a table that the sensor bends."""

import numpy as np
import pytest

from grasping.segmentation.frame import Frame
from grasping.segmentation.table_relief import Relief, relief
from tests.grasping.rendered_scenes import look_down, render

SIGMA = 0.0015  # 1/m


def seen(boxes: list[tuple], bend: float, seed: int = 0) -> tuple[Relief, np.ndarray]:
    """The relief of boxes on a table that the sensor bends by so much (1/m) with noise, and the true labels (h, w)."""
    T = look_down(30.0, 0.8)
    frame, labels = render(boxes, T, 0.0)
    h, w = frame.shape[:2]
    row, column = np.linspace(-1, 1, h)[:, None], np.linspace(-1, 1, w)
    q = 1 / frame[..., 2] + bend * (row**2 + 0.5 * column**3)
    q += np.random.default_rng(seed).normal(0, SIGMA, q.shape)
    frame = frame / (frame[..., 2:] * q[..., None])
    plane = np.append(T[:3, :3].T @ [0.0, 0.0, 1.0], T[2, 3])
    image = Frame(frame, (0.0, 2.0)).working_image(plane)
    assert image is not None
    positions = image.positions()
    height = (positions @ plane[:3] + plane[3]).astype(np.float32)
    return relief(image, image.plane_inverse_depth(plane), height), np.asarray(labels).reshape(image.shape)


@pytest.mark.parametrize("bend", [0.0, 0.01])
def test_a_bent_table_is_a_table(bend: float) -> None:
    found, _ = seen([], bend)
    assert found.stands_out.mean() < 0.002
    assert found.noise == pytest.approx(SIGMA, rel=0.25)


@pytest.mark.parametrize("bend", [0.0, 0.008])
def test_a_card_of_5_mm_stands_out_and_so_does_a_box(bend: float) -> None:
    card, box = (-0.08, 0.0, 0.09, 0.12, 0.005), (0.1, 0.0, 0.06, 0.08, 0.1)
    found, labels = seen([card, box], bend)
    for number in (0, 1):
        inside = labels == number
        assert found.stands_out[inside].mean() > 0.8
    table = labels == -1
    assert found.stands_out[table].mean() < 0.01
