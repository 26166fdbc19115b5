"""A share of a job that several processes or machines divide among them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


class JobShareError(ValueError):
    """A share that is not of the form i/n with 0 ≤ i < n; the message has the text."""


@dataclass(frozen=True)
class JobShare:
    """Job `index` of `count`, 0 ≤ index < count."""

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> JobShare:
        """Of "0/8". Raises JobShareError where it is not of that form."""
        match = re.fullmatch(r"(\d+)/(\d+)", text)
        share = cls(*map(int, match.groups())) if match else cls(0, 0)
        if share.index >= share.count:
            raise JobShareError(f"shard={text!r}: must be i/n with 0 ≤ i < n, such as 0/8 for the first of eight jobs")
        return share

    @property
    def suffix(self) -> str:
        """What tells this share's files from those of the others: ".0of8"."""
        return f".{self.index}of{self.count}"

    def of(self, jobs: Sequence[T]) -> Sequence[T]:
        """This share of the jobs: neighbours, so that few objects are loaded in more than one share."""
        return jobs[len(jobs) * self.index // self.count : len(jobs) * (self.index + 1) // self.count]
