"""Strangers among a data set's classes, and those that are made of its clouds."""

from dataclasses import replace

import numpy as np
import pytest

from pec.data.dataset import UNKNOWN
from pec.data.labelled_arrays import write_labelled
from pec.data.loading import load_dataset
from pec.data.made_strangers import made_strangers
from pec.data.splits import split_by_sample
from pec.training.run_split import hold_out_instances


def _write(path, classes, instances_of, samples=6):
    """Clouds of 80 points; instances_of: how many each class has."""
    rng = np.random.default_rng(0)
    clouds, labels, instances = [], [], []
    for label, count in enumerate(instances_of):
        for instance in range(count):
            for _ in range(samples):
                clouds.append(rng.normal(scale=0.01 * (label + 1), size=(80, 3)))
                labels.append(label)
                instances.append(f"{label} {instance}")
    write_labelled(path, clouds, labels, instances, classes)
    return load_dataset(path)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_strangers_are_the_last_class_wherever_they_stood(tmp_path, place):
    names = ["mug", "can"]
    names.insert(place, UNKNOWN)
    dataset = _write(tmp_path / "c.npz", names, [1 + (name == UNKNOWN) for name in names])
    assert dataset.classes == ["mug", "can", UNKNOWN]
    assert dataset.known_classes == ["mug", "can"]
    assert dataset.has_strangers
    assert np.bincount(dataset.labels).tolist() == [6, 6, 12]
    assert dataset.is_known.tolist() == (dataset.labels < 2).tolist()
    chosen = load_dataset(tmp_path / "c.npz", classes=[UNKNOWN, "can"])
    assert chosen.classes == ["can", UNKNOWN]
    assert np.bincount(chosen.labels).tolist() == [6, 12]


def _parts(dataset, seed=0):
    rng = np.random.default_rng(seed)
    rest, test = split_by_sample(dataset, 0.75, rng)
    return (*split_by_sample(dataset, 0.8, rng, rest), test)


def test_of_classes_with_enough_instances_some_are_kept_for_calibration(tmp_path):
    dataset = _write(tmp_path / "c.npz", ["mug", "can", "box"], [10, 4, 3])
    parts = hold_out_instances(dataset, _parts(dataset), 0.2, 0)
    kept = set(dataset.instances[parts.calibration]) - set(dataset.instances[parts.training])
    assert [dataset.labels[dataset.instances == each][0] for each in sorted(kept)] == [0, 0, 1]
    assert parts.seen == ["box"]  # of three instances none can be spared
    used = np.concatenate([parts.training, parts.selection, parts.test])
    assert len(used) == len(set(used))
    assert np.array_equal(parts.test, _parts(dataset)[2])
    seen = set(dataset.instances[dataset.labels < 2]) & set(dataset.instances[parts.selection])
    assert not kept & seen


def test_what_is_kept_for_calibration_has_no_copy_in_training(tmp_path):
    dataset = _write(tmp_path / "c.npz", ["mug", "can"], [20, 12])
    dataset = replace(dataset, originals=dataset.instances // 4 * 4)  # five mugs and three cans, three copies of each
    parts = hold_out_instances(dataset, _parts(dataset), 0.2, 0)
    kept = dataset.things[parts.calibration][dataset.labels[parts.calibration] == 0]
    assert len(set(kept)) == 1
    assert not set(kept) & set(dataset.things[parts.training])
    assert parts.seen == ["can"]


def test_nothing_is_kept_back_where_selection_is_of_unseen_instances(tmp_path):
    dataset = _write(tmp_path / "c.npz", ["mug", "can"], [20, 20], samples=1)
    before = _parts(dataset)
    parts = hold_out_instances(dataset, before, 0.2, 0)
    assert parts.seen == []
    assert np.array_equal(parts.training, before[0])
    assert np.array_equal(parts.calibration, before[1])
    assert hold_out_instances(dataset, before, 0.0, 0).seen == []


def test_made_strangers_are_clouds_that_their_seed_decides():
    rng = np.random.default_rng(0)
    clouds = [rng.normal(scale=(0.05, 0.02, 0.01), size=(n, 3)) + 0.5 for n in (64, 300, 6000)]
    made = made_strangers(clouds, 40, 64, np.random.default_rng(1))
    assert len(made) == 40
    assert all(cloud.dtype == np.float32 and len(cloud) >= 64 and np.isfinite(cloud).all() for cloud in made)
    again = made_strangers(clouds, 40, 64, np.random.default_rng(1))
    assert all(np.array_equal(a, b) for a, b in zip(made, again, strict=True))
    assert made_strangers(clouds, 0, 64, rng) == []
