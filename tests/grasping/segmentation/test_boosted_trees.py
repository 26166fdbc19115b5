"""Trees of a file, and grouping by what they say."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasping.errors import ConfigError
from grasping.segmentation.boosted_trees import KINDS, BoostedTrees, Relations, read_relations, write_relations
from grasping.segmentation.correlation_clustering import cluster, cluster_reference
from grasping.segmentation.trained import NAMES, trained_relations

# x0 ≤ 1 → (x1 ≤ 0 → 1, else 2), else 4; and a leaf of 0.5. x0 that is not known goes left, x1 right.
TREES = BoostedTrees(
    feature=np.array([0, 1, -1, -1, -1, -1], dtype=np.int32),
    threshold=np.array([1, 0, 0, 0, 0, 0], dtype=np.float32),
    left=np.array([1, 3, 0, 0, 0, 0], dtype=np.int32),
    right=np.array([2, 4, 0, 0, 0, 0], dtype=np.int32),
    missing_left=np.array([1, 0, 0, 0, 0, 0], dtype=np.int32),
    value=np.array([0, 0, 4, 1, 2, 0.5]),
    start=np.array([0, 5], dtype=np.int32),
    baseline=-0.25,
)
ROWS = np.array([[0, -1], [1, 0], [0, 1], [2, 0], [np.nan, 0], [0, np.nan], [np.nan, np.nan]], dtype=np.float32)
ODDS = np.array([1, 1, 2, 4, 1, 2, 2]) + 0.25


def test_a_row_falls_to_its_leaf_in_each_tree() -> None:
    np.testing.assert_array_equal(TREES.log_odds(ROWS), ODDS)
    np.testing.assert_array_equal(TREES.log_odds_reference(ROWS), ODDS)
    assert TREES.log_odds(ROWS[:0]).shape == (0,)


def test_a_file_gives_back_what_was_written_and_refuses_other_features(tmp_path) -> None:
    names = dict.fromkeys(KINDS, ("width", "height"))
    file = tmp_path / "relations.npz"
    write_relations(file, Relations(*[TREES] * 6, {"data": "abc"}), names)
    read = read_relations(file, names)
    np.testing.assert_array_equal(read.whole.log_odds(ROWS), ODDS)
    assert read.about == {"data": "abc"}
    with pytest.raises(ConfigError, match=r"other features.*train-segmenter"):
        read_relations(file, names | {"far": ("width", "depth")})
    file.write_bytes(b"nothing")
    with pytest.raises(ConfigError, match="not a file of pecgrasp train-segmenter"):
        read_relations(file, names)


def test_the_package_brings_trees_and_says_what_they_are_from() -> None:
    relations = trained_relations()
    assert {"data", "frames", "seed", "found_75"} <= set(relations.about)
    for kind in KINDS:
        trees: BoostedTrees = getattr(relations, kind)
        assert trees.feature.max() < len(NAMES[kind])
        assert np.isfinite(trees.value).all()


def test_one_false_link_does_not_join_two_things() -> None:
    # Two triangles of firm friends, and a single link between them that all other pairs speak against.
    pairs = {
        (0, 1): 2.0,
        (0, 2): 2.0,
        (1, 2): 2.0,
        (3, 4): 2.0,
        (3, 5): 2.0,
        (4, 5): 2.0,
        (2, 3): 1.5,
        (1, 3): -3,
        (2, 4): -3,
    }
    first, second = np.array(list(pairs)).T
    assert cluster(6, first, second, np.array(list(pairs.values()), dtype=float)).tolist() == [0, 0, 0, 1, 1, 1]


@given(st.data())
def test_every_group_of_two_or_more_hangs_together_by_more_agreement_than_disagreement(data) -> None:
    count = data.draw(st.integers(1, 9))
    pairs = [pair for pair in combinations(range(count), 2) if data.draw(st.booleans())]
    values = [data.draw(st.integers(-8, 8)) / 4 for _ in pairs]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    root = cluster_reference(count, first, second, np.array(values, dtype=float))
    groups = cluster(count, first, second, np.array(values, dtype=float))
    np.testing.assert_array_equal(groups[:, None] == groups, root[:, None] == root)
    inside: dict[int, float] = {}
    across: dict[tuple[int, int], float] = {}
    for (i, j), value in zip(pairs, values, strict=True):
        if groups[i] == groups[j]:
            inside[groups[i]] = inside.get(groups[i], 0.0) + value
        else:
            key = (min(groups[i], groups[j]), max(groups[i], groups[j]))
            across[key] = across.get(key, 0.0) + value
    for group in set(groups.tolist()):
        if np.count_nonzero(groups == group) > 1:
            assert inside[group] > 0
    assert all(value <= 0 for value in across.values())
