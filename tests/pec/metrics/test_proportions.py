"""What counts are worth: Wilson's interval and McNemar's exact test, against tables and against SciPy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from pec.metrics.proportions import ProportionError, mcnemar, wilson_interval


@pytest.mark.parametrize(
    ("successes", "n", "interval"),
    [
        (19, 20, (0.764, 0.991)),
        (0, 10, (0.0, 0.278)),
        (10, 10, (0.722, 1.0)),
        (50, 100, (0.404, 0.596)),
        (9, 10, (0.5958, 0.9821)),
        (100, 100, (0.9630, 1.0)),
    ],
)
def test_wilson_intervals_of_the_tables(successes, n, interval):
    assert wilson_interval(successes, n) == pytest.approx(interval, abs=5e-4)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_holds_the_share_and_mirrors(case):
    successes, n = case
    low, high = wilson_interval(successes, n)
    assert 0 <= low <= successes / n <= high <= 1
    mirrored = wilson_interval(n - successes, n)
    assert (1 - high, 1 - low) == pytest.approx(mirrored)


@pytest.mark.parametrize(("successes", "n"), [(0, 0), (3, 2), (-1, 5)])
def test_no_proportion_is_refused(successes, n):
    with pytest.raises(ProportionError, match="no proportion"):
        wilson_interval(successes, n)


@pytest.mark.parametrize(
    ("only_first", "only_second", "p"),
    [(0, 0, 1.0), (5, 0, 2 / 32), (0, 10, 2 / 1024), (1, 5, 14 / 64), (4, 4, 1.0), (2, 8, 112 / 1024)],
)
def test_mcnemar_of_known_counts(only_first, only_second, p):
    assert mcnemar(only_first, only_second) == pytest.approx(p)


@given(st.integers(0, 300), st.integers(0, 300))
def test_mcnemar_is_a_binomial_test_of_one_half(only_first, only_second):
    n = only_first + only_second
    expected = binomtest(only_first, n, 0.5).pvalue if n else 1.0
    assert mcnemar(only_first, only_second) == pytest.approx(expected)
    assert mcnemar(only_first, only_second) == mcnemar(only_second, only_first)


def test_negative_counts_are_refused():
    with pytest.raises(ProportionError, match="only_second=-1"):
        mcnemar(3, -1)
