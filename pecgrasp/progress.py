"""A progress bar for work that goes on where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

__all__ = ["progress_bar"]


@contextmanager
def progress_bar(unit: str, *, shown: bool, title: str | None = None) -> Iterator[Callable[[int, int], None]]:
    """Yields `progress(done, total)`, which moves the bar on; there is none before its first call."""
    bar: tqdm | None = None

    def progress(done: int, total: int) -> None:
        nonlocal bar
        if bar is None:
            # What was there already counts neither as work nor in the time left.
            bar = tqdm(unit=unit, desc=title, disable=not shown, total=total, initial=done)
        bar.total = total
        bar.update(done - bar.n)

    try:
        yield progress
    finally:
        if bar is not None:
            bar.close()
