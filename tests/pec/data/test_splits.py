"""Splits never overlap, keep the proportions of the classes, and are the same for everybody once they are stored."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pec.data.dataset import CloudDataset
from pec.data.loading import load_dataset
from pec.data.splits import SPLITS_NAME, divide, read_splits, split_by_instance, split_by_sample, write_splits
from pec.errors import DatasetError


def labelled(instances_of_class: list[int], samples: list[int]) -> CloudDataset:
    """Class c has instances_of_class[c] instances, instance i of all has samples[i % len(samples)] samples."""
    labels, instances = [], []
    for label, count in enumerate(instances_of_class):
        for _ in range(count):
            number = len(set(instances))
            n = samples[number % len(samples)]
            labels += [label] * n
            instances += [number] * n
    classes = [f"class_{label}" for label in range(len(instances_of_class))]
    return CloudDataset(
        classes, [np.zeros((1, 3), np.float32)] * len(labels), np.array(labels), np.array(instances), ""
    )


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_split_by_sample_takes_its_share_of_each_instance(shapes, seed):
    dataset = load_dataset(shapes)
    first, second = split_by_sample(dataset, 0.75, np.random.default_rng(seed))
    assert sorted([*first, *second]) == list(range(len(dataset)))
    assert np.bincount(dataset.instances[first]).tolist() == [15] * 6


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(0.05, 0.95))
def test_split_by_instance_shares_none(shapes, seed, fraction):
    dataset = load_dataset(shapes)
    first, second = split_by_instance(dataset, fraction, np.random.default_rng(seed))
    assert sorted([*first, *second]) == list(range(len(dataset)))
    assert not set(dataset.instances[first]) & set(dataset.instances[second])
    for part in (first, second):
        assert set(dataset.labels[part]) == {0, 1, 2}


def test_split_by_instance_of_single_instances_is_an_error(shapes):
    dataset = load_dataset(shapes)
    single = dataset.subset(np.flatnonzero(dataset.instances % 2 == 0))
    with pytest.raises(DatasetError, match="'ball' has 1 instance"):
        split_by_instance(single, 0.5, np.random.default_rng(0))


def with_copies(dataset: CloudDataset, n: int) -> CloudDataset:
    """Of each class the instances from the n-th on are copies of its first n, in turn."""
    originals = dataset.instances.copy()
    for label in np.unique(dataset.labels):
        own = np.unique(dataset.instances[dataset.labels == label])
        for place, instance in enumerate(own):
            originals[dataset.instances == instance] = own[place % n]
    return replace(dataset, originals=originals)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(0.05, 0.95))
def test_deformed_copies_are_on_the_side_of_their_original(seed, fraction):
    dataset = with_copies(labelled([6, 12], [3, 5]), 3)
    first, second = split_by_instance(dataset, fraction, np.random.default_rng(seed))
    assert sorted([*first, *second]) == list(range(len(dataset)))
    assert not set(dataset.things[first]) & set(dataset.things[second])
    for part in (first, second):
        assert set(dataset.labels[part]) == {0, 1}


def test_copies_of_one_instance_cannot_be_split_by_instance():
    with pytest.raises(DatasetError, match=r"'class_0' has 1 instance.*deformed copies aside"):
        split_by_instance(with_copies(labelled([8, 8], [2]), 1), 0.5, np.random.default_rng(0))


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.integers(2, 6), min_size=1, max_size=4),
    st.lists(st.integers(4, 20), min_size=1, max_size=5),
    st.integers(0, 100),
)
def test_stored_splits_are_read_back_never_overlap_and_are_stratified(tmp_path_factory, instances, samples, seed):
    directory = tmp_path_factory.mktemp("splits")
    dataset = labelled(instances, samples)
    write_splits(directory, dataset, seed)
    stored = replace(dataset, test=read_splits(directory, len(dataset)))
    rng = np.random.default_rng(0)
    by_sample, by_instance = divide(stored, "sample", 0.75, rng), divide(stored, "instance", 0.75, rng)
    for rest, test in (by_sample, by_instance):
        assert sorted([*rest, *test]) == list(range(len(dataset)))
    for instance in np.unique(dataset.instances):
        n = (dataset.instances == instance).sum()
        assert (dataset.instances[by_sample[0]] == instance).sum() == round(0.75 * n)
    assert not set(dataset.instances[by_instance[0]]) & set(dataset.instances[by_instance[1]])
    for label, n in enumerate(instances):
        of_train = np.unique(dataset.instances[by_instance[0]][dataset.labels[by_instance[0]] == label])
        assert len(of_train) == min(max(round(0.75 * n), 1), n - 1)


def test_the_stored_split_is_every_runs_split_and_another_fraction_is_drawn():
    dataset = labelled([2, 2], [10])
    first, second = np.random.default_rng(0), np.random.default_rng(1)
    test = np.zeros(40, bool)
    test[::4] = True
    stored = replace(dataset, test={"sample": test})
    assert divide(stored, "sample", 0.75, first)[1].tolist() == divide(stored, "sample", 0.75, second)[1].tolist()
    assert divide(stored, "sample", 0.75, first)[1].tolist() == list(range(0, 40, 4))
    assert len(divide(stored, "sample", 0.5, first)[1]) == 20
    drawn = divide(stored, "instance", 0.75, first)
    assert drawn[1].tolist() != divide(stored, "instance", 0.75, np.random.default_rng(3))[1].tolist()
    part = stored.subset(np.flatnonzero(~test))  # of which the stored split would leave nothing to test
    assert len(divide(part, "sample", 0.75, first)[1]) == 8


def test_a_split_that_the_data_do_not_allow_is_left_out(tmp_path):
    write_splits(tmp_path, labelled([1, 2], [8]), 0)
    assert set(read_splits(tmp_path, 24)) == {"sample"}
    assert read_splits(tmp_path / "nowhere", 24) == {}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not a list of splits"),
        ({"schema_version": 1, "test": {"sample": [120]}}, "of 120 samples"),
        ({"schema_version": 1}, "KeyError"),
        ({"schema_version": 5, "test": {}}, "schema version 5"),
    ],
)
def test_broken_splits_are_named(shapes, tmp_path, content, message):
    shutil.copytree(shapes, tmp_path / "data")
    (tmp_path / "data" / SPLITS_NAME).write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(DatasetError, match=rf"splits\.json.*{message}"):
        load_dataset(tmp_path / "data")


def test_training_tests_on_the_stored_split_whatever_its_seed(shapes, tmp_path):
    from pec.training.config import DatasetConfig
    from pec.training.run_split import split

    directory = shutil.copytree(shapes, tmp_path / "data")
    write_splits(directory, load_dataset(directory), 5)
    dataset = load_dataset(directory)
    for way in ("sample", "instance"):
        parts = [split(dataset, DatasetConfig(str(directory), split=way), "validation", seed) for seed in (0, 1)]
        stored = np.flatnonzero(dataset.test[way])
        for training, selection, test in parts:
            assert test.tolist() == stored.tolist()
            assert sorted([*training, *selection, *test]) == list(range(len(dataset)))
        assert parts[0][1].tolist() != parts[1][1].tolist()


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.lists(st.integers(1, 4), min_size=1, max_size=6), min_size=1, max_size=4),
    st.sampled_from([0.75, 0.9]),
    st.integers(0, 99),
)
def test_split_by_sample_gives_the_second_part_something_of_each_class_that_has_enough(sizes, fraction, seed):
    """Few samples of some instances, one of others: no class may lie on one side because of rounding."""
    labels = [label for label, of_class in enumerate(sizes) for n in of_class for _ in range(n)]
    counts = [n for of_class in sizes for n in of_class]
    instances = np.repeat(np.arange(len(counts)), counts)
    names = [f"class_{label}" for label in range(len(sizes))]
    clouds = [np.zeros((1, 3), np.float32)] * len(labels)
    dataset = CloudDataset(names, clouds, np.array(labels), instances, "")
    first, second = split_by_sample(dataset, fraction, np.random.default_rng(seed))
    assert sorted([*first, *second]) == list(range(len(labels)))
    for label in range(len(sizes)):
        n = int((dataset.labels == label).sum())
        if round(fraction * n) < n:
            assert label in dataset.labels[second]
    if round(fraction * len(labels)) < len(labels):
        assert len(second)
