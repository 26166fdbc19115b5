"""Augmentation does what its settings say, and nothing else."""

import pytest
import torch

from pec.data.augment import Augment, augment
from pec.errors import ConfigError


def _clouds(batch: int = 50, n: int = 100) -> tuple[torch.Tensor, torch.Tensor]:
    points = torch.randn(batch, n, 3, generator=torch.Generator().manual_seed(0))
    valid = torch.ones(batch, n, dtype=torch.bool)
    valid[:, n // 2 :] = torch.arange(batch)[:, None] % 2 == 0
    return points, valid


def _augment(**settings: float) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    points, valid = _clouds()
    return points, valid, *augment(points, valid, Augment(**settings), torch.Generator().manual_seed(1))


def test_nothing_set_changes_nothing():
    points, valid, new_points, new_valid = _augment()
    assert points.equal(new_points)
    assert valid.equal(new_valid)


@pytest.mark.parametrize("name", ["remove", "crop", "holes", "facing"])
def test_removal_stays_below_its_share_and_uses_its_range(name):
    points, valid, new_points, new_valid = _augment(**{name: 0.4})
    assert points.equal(new_points)
    assert not (new_valid & ~valid).any()
    share = 1 - new_valid.sum(dim=1) / valid.sum(dim=1)
    assert share.max() <= 0.4
    assert share.max() > 0.3
    assert share.min() < 0.1


def test_cropped_points_lie_beyond_a_plane():
    points, valid, _, kept = _augment(crop=0.4)
    for cloud, before, after in zip(points, valid, kept, strict=True):
        gone = before & ~after
        if gone.sum() < 3:
            continue
        # Linearly separable: a perceptron finds the plane.
        inputs = torch.cat([cloud[before], torch.ones(int(before.sum()), 1)], dim=1)
        sign = torch.where(gone[before], 1.0, -1.0)
        plane = torch.zeros(4)
        for _ in range(2000):
            wrong = (inputs @ plane) * sign <= 0
            if not wrong.any():
                break
            plane += (inputs[wrong] * sign[wrong, None]).mean(dim=0)
        assert not wrong.any()
        break


def test_what_faces_one_way_goes_together():
    # A roof: two slopes of 45°, which meet along y.
    generator = torch.Generator().manual_seed(0)
    x, y = torch.rand(2, 40, 128, generator=generator) - 0.5
    roof = torch.stack([x, y, x.abs()], dim=2)
    valid = torch.ones(40, 128, dtype=torch.bool)
    _, kept = augment(roof, valid, Augment(facing=0.6), generator)
    lost = ~kept & (x.abs() > 0.1)  # about the ridge the surface faces neither way
    sides = torch.stack([(lost & (x < 0)).sum(dim=1), (lost & (x > 0)).sum(dim=1)], dim=1)
    few = (lost.sum(dim=1) > 5) & (lost.sum(dim=1) < 40)  # of more, one slope is not enough
    assert few.sum() > 5
    assert (sides[few].amin(dim=1) <= 0.15 * sides[few].sum(dim=1)).float().mean() > 0.8


def test_a_surface_seen_edge_on_or_a_single_point_faces_some_way_too():
    points = torch.zeros(3, 100, 3)
    points[0, :, 1:] = torch.randn(100, 2, generator=torch.Generator().manual_seed(0))  # x is the same
    valid = torch.ones(3, 100, dtype=torch.bool)
    valid[1, 1:] = False
    changed, kept = augment(points, valid, Augment(facing=0.6, holes=0.6), torch.Generator().manual_seed(1))
    assert changed.isfinite().all()
    assert kept.any(dim=1).all()


def test_yaw_turns_about_z_only():
    points, _, turned, _ = _augment(yaw=30)
    assert turned[..., 2].equal(points[..., 2])
    assert torch.allclose(turned.norm(dim=2), points.norm(dim=2), atol=1e-5)
    cosine = (turned[..., :2] * points[..., :2]).sum(dim=2) / points[..., :2].norm(dim=2).square()
    assert cosine.acos().rad2deg().max() <= 30.1


def test_scale_mirror_and_jitter_keep_to_their_ranges():
    points, _, scaled, _ = _augment(scale=0.1)
    ratio = (scaled / points).flatten(1)
    assert torch.allclose(ratio.amin(dim=1), ratio.amax(dim=1), atol=1e-5)
    assert (ratio - 1).abs().max() <= 0.1001
    _, _, mirrored, _ = _augment(mirror=0.5)
    flipped = (mirrored[..., 0] == -points[..., 0]).all(dim=1)
    assert 10 < flipped.sum() < 40
    assert mirrored[..., 1:].equal(points[..., 1:])
    _, _, shaken, _ = _augment(jitter=0.01)
    assert (shaken - points).std().item() == pytest.approx(0.01, rel=0.05)


def test_senseless_strength_is_named():
    with pytest.raises(ConfigError, match=r"augment\.remove must be in \[0, 1\], got 1\.5"):
        Augment(remove=1.5)


def test_subset_keeps_its_share_and_every_cloud():
    points, valid, kept, kept_valid = _augment(subset=0.7)
    assert kept.shape == (50, 70, 3)
    columns = [(points[0] == column).all(dim=1).nonzero().item() for column in kept[0]]
    assert len(set(columns)) == 70
    assert kept.equal(points[:, columns])
    assert kept_valid.equal(valid[:, columns])
    padded = torch.arange(100) < torch.ones(4, 1)
    assert augment(points[:4], padded, Augment(subset=0.7), torch.Generator())[1].sum(dim=1).tolist() == [1] * 4
    assert augment(points[:, :64], valid[:, :64], Augment(subset=0.1), torch.Generator())[0].equal(points[:, :64])


def test_stretch_scales_each_axis_by_itself_within_its_range():
    points, valid, stretched, _ = _augment(stretch=0.3)
    factors = (stretched / points)[valid]
    assert factors.min() >= 0.7 - 1e-5
    assert factors.max() <= 1.3 + 1e-5
    of_first = (stretched[0] / points[0]).mean(dim=0)
    assert torch.allclose(stretched[0], points[0] * of_first, atol=1e-5)
    assert of_first.diff().abs().min() > 1e-3
