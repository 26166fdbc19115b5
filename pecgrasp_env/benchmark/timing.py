"""Routines timed side by side, and the rows of a report on them.

Limits are multiples of a yardstick that the same run measures, such as a k-d tree of the same points: milliseconds hold
on one machine, as busy as it was, and are for information.

Routines that are compared take turns, so that a busy machine slows all of them alike. Every number is a median. Beside
the time on the clock stands the processor's time: where the machine has other work to do the first grows and the second
hardly.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Row = dict[str, Any]


@dataclass(frozen=True)
class Timing:
    """Median seconds of a routine: on the clock, and of this process's processor time."""

    wall: float
    cpu: float


def side_by_side(routines: Mapping[str, Callable[[], Any]], repeats: int, *, warm: bool = False) -> dict[str, Timing]:
    """Time the routines, which take turns, after one turn that does not count.

    warm: each is called once more before it is timed, so that it finds its own data in the processor's caches.
    """
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in routines}
    for repeat in range(repeats + 1):
        for name, routine in routines.items():
            if warm:
                routine()
            wall, cpu = time.perf_counter(), time.process_time()
            routine()
            if repeat:
                seconds[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: Timing(*np.median(each, axis=0).tolist()) for name, each in seconds.items()}


def rows_of(times: Mapping[str, Timing], yardstick: str, what: str, rate: str | None = None) -> list[Row]:
    """One row a routine. Its ratio to the yardstick is of processor time, or of the clock's where there is a rate:
    processes and the renderer's threads work side by side.
    """
    rows = []
    for name, each in times.items():
        row: Row = {"what": what, "name": name, "wall_ms": 1000 * each.wall}
        if rate is None:
            row |= {"cpu_ms": 1000 * each.cpu, "times_yardstick": each.cpu / times[yardstick].cpu}
        else:
            row |= {"times_yardstick": each.wall / times[yardstick].wall, "rate": 1 / each.wall, "unit": rate}
        rows.append(row)
    return rows


def limited(row: Row, at_most: float | None) -> Row:
    """The row with its limit, a multiple of the yardstick, and whether it is held; as it is where there is none."""
    if at_most is None:
        return row
    return row | {"at_most": float(at_most), "held": row["times_yardstick"] <= at_most}


def line_of(row: Row) -> str:
    """The row as a line of a table for people."""
    head = f"  {row['what']:<44}{row['name']:<28}"
    if "growth_mb" in row:
        first, second = row["growth_first_half_mb"], row["growth_mb"]
        return f"{head}{first:>+10.1f} MB in the first half, {second:+.1f} in the second, of {row['mb']:,.0f} MB"
    if "exponent" in row:
        return f"{head}{row['exponent']:>10.2f} in the exponent{'':<17}{row['times_longer']:>9.2f} x"
    other = f"{row['rate']:>10.1f} {row['unit']}" if "rate" in row else f"{row['cpu_ms']:>10.3f} ms of processor"
    target = f"   at most {row['at_most']:g} x: {'held' if row['held'] else 'NOT HELD'}" if "at_most" in row else ""
    target += f"   150 epochs: {row['extrapolated_s']:.0f} s, extrapolated" if "extrapolated_s" in row else ""
    return f"{head}{row['wall_ms']:>10.3f} ms{other:<30}{row['times_yardstick']:>9.2f} x{target}"
