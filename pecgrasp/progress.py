"""A progress bar for work that goes on where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

__all__ = ["progress_bar"]


@contextmanager
def progress_bar(unit: str, *, shown: bool, title: str | None = None) -> Iterator[Callable[[int, int], None]]:
    """Yields `progress(done, total)`, which moves the bar on."""
    with tqdm(unit=unit, desc=title, disable=not shown) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            if bar.n == 0:
                bar.initial = done  # what was there already counts neither as work nor in the time left
            bar.update(done - bar.n)

        yield progress
