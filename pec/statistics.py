"""What counts out of n cases are worth: Wilson's interval of one share, McNemar's test of two on the same cases."""

from __future__ import annotations

import math

__all__ = ["ProportionError", "mcnemar", "wilson_interval"]


class ProportionError(ValueError):
    """Counts that are no proportion; the message says which."""


def wilson_interval(successes: float, n: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's score interval of a proportion, 95 % by default: Wilson (1927), as in Brown, Cai and DasGupta (2001).

    successes: a mean over several seeds need not be whole. Raises ProportionError unless 0 ≤ successes ≤ n and n > 0.
    """
    if not 0 <= successes <= n or n == 0:
        raise ProportionError(f"{successes} successes of {n}: no proportion")
    p = successes / n
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    # At the ends the formula is exact but its arithmetic is not.
    return (0.0 if successes == 0 else centre - half, 1.0 if successes == n else centre + half)


def mcnemar(only_first: int, only_second: int) -> float:
    """Two-sided p value of McNemar's exact test (1947): do two methods succeed equally often on the same cases?

    only_first, only_second: cases in which only the one succeeded; the others say nothing. Under equality each of these
    falls to either with probability 1/2, so p is twice the smaller binomial tail, at most 1. Exact for any count.
    Raises ProportionError for a negative count.
    """
    if min(only_first, only_second) < 0:
        raise ProportionError(f"only_first={only_first}, only_second={only_second}: counts must not be negative")
    n = only_first + only_second
    tail = sum(math.comb(n, k) for k in range(min(only_first, only_second) + 1))
    return min(1.0, 2 * tail / 2**n)
