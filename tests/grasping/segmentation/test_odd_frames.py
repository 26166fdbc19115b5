"""Frames of every kind that a sensor or a driver may hand over end in a scene or in a CloudError."""

import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.spatial.transform import Rotation

from grasping import CloudError, Segmenter


def odd_frame(seed: int) -> np.ndarray:
    """(H, W, 3) or (N, 3): random surfaces over a table at any angle, with noise, holes and values without sense."""
    rng = np.random.default_rng(seed)
    sides = rng.integers(1, 70, size=2)
    height, width = sides if rng.random() < 0.9 else rng.choice([[1, sides[1]], [sides[0], 1], [2, 2], [3, 3]])
    v, u = np.mgrid[:height, :width]
    focal = max(height, width) * rng.uniform(0.4, 2.0)
    rays = np.stack([(u - width / 2) / focal, (v - height / 2) / focal, np.ones(u.shape)], axis=-1)
    normal = Rotation.random(random_state=seed % 2**32).as_matrix()[2]
    depth = rng.uniform(0.2, 1.5) / np.maximum(rays @ (normal * np.sign(normal[2] or 1)), 0.05)
    for _ in range(rng.integers(0, 8)):
        row, column = rng.integers(0, height), rng.integers(0, width)
        tall, wide = rng.integers(1, max(height // 2, 2)), rng.integers(1, max(width // 2, 2))
        part = depth[row : row + tall, column : column + wide]
        part -= rng.uniform(0, 0.25) if rng.random() < 0.7 else rng.uniform(0, 0.2, size=part.shape)
    if rng.random() < 0.3:
        depth = ndimage.uniform_filter(depth, int(rng.integers(1, 8)))  # ramps at edges
    depth = depth + rng.normal(size=depth.shape) * rng.choice([0.0, 0.001, 0.01, 0.1])
    frame = rays * depth[..., None]
    if rng.random() < 0.3:
        frame = frame @ Rotation.random(random_state=seed % 2**32).as_matrix().T + rng.uniform(-1, 1, 3)
    for value in (np.nan, 0.0, np.inf, -np.inf, 1e30):
        if rng.random() < 0.3:
            frame[ndimage.uniform_filter(rng.random(u.shape), int(rng.integers(1, 6))) < rng.uniform(0, 0.6)] = value
    if rng.random() < 0.2:
        frame[rng.integers(0, height) :] = frame[rng.integers(0, height)]
    frame = frame.astype(rng.choice([np.float32, np.float64]))
    return frame.reshape(-1, 3) if rng.random() < 0.1 else frame


def check(seed: int) -> None:
    """Raises for whatever but a scene that accounts for every point, or a CloudError."""
    frame = odd_frame(seed)
    rng = np.random.default_rng(seed + 1)
    how = {} if rng.random() < 0.5 else {"up": rng.normal(size=3)}
    if rng.random() < 0.2:
        how["viewpoint"] = rng.uniform(-0.5, 0.5, 3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            scene = Segmenter(min_points=int(rng.integers(3, 60))).segment(frame, **how)
        except CloudError:
            return
    rejected = sum(entry.n_points for entry in scene.rejected if entry.what != "plane")
    assert sum(map(len, scene.indices)) + scene.n_table + rejected == frame.size // 3
    lengths = {len(each) for each in (scene.objects, scene.indices, scene.touches_border, scene.unseen)}
    assert len(lengths) == 1
    assert all(np.isfinite(far).all() for far in scene.unseen)
    assert scene.summary()


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_an_odd_frame_ends_in_a_scene_that_accounts_for_every_point(seed: int) -> None:
    check(seed)
