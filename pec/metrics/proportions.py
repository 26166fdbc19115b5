"""What counts out of n cases are worth: Wilson's interval of one share, McNemar's test of two on the same cases."""

from __future__ import annotations

__all__ = ["ProportionError", "mcnemar", "wilson_interval"]


class ProportionError(ValueError):
    """Counts that are no proportion; the message says which."""


def wilson_interval(successes: int, n: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a proportion: Wilson (1927), as in Brown, Cai and DasGupta (2001).

    Raises ProportionError unless 0 ≤ successes ≤ n and n > 0.
    """
    from scipy.stats import binomtest  # slow to import, and commands that never get to a table import this module

    if not 0 <= successes <= n or n == 0:
        raise ProportionError(f"{successes} successes of {n}: no proportion")
    interval = binomtest(successes, n).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def mcnemar(only_first: int, only_second: int) -> float:
    """Two-sided p value of McNemar's exact test (1947): do two methods succeed equally often on the same cases?

    only_first, only_second: cases in which only the one succeeded; the others say nothing. Under equality each of these
    falls to either with probability 1/2: a binomial test of that. Raises ProportionError for a negative count.
    """
    from scipy.stats import binomtest

    if min(only_first, only_second) < 0:
        raise ProportionError(f"only_first={only_first}, only_second={only_second}: counts must not be negative")
    n = only_first + only_second
    # The smaller of both: p is then the same to the last bit whichever method is the first.
    return float(binomtest(min(only_first, only_second), n).pvalue) if n else 1.0
