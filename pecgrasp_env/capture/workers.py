"""Makes shards: in this process, or in several of them that each render on one core."""

from __future__ import annotations

import hashlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections import deque
from collections.abc import Generator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from pec.data.shards import ShardRecord, shard_name, write_shard
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.scenarios import open_scenario
from pecgrasp_env.capture.scenarios.base import Subject
from pecgrasp_env.capture.shard_plan import ShardJob, instance_entry, open_source
from pecgrasp_env.objects import ObjectError, ObjectModel

__all__ = ["Result", "make_shards"]


_GO_ON = "on_error=skip goes on with the other objects"


Result = tuple[ShardRecord, list[dict[str, Any]]]
"""A written shard, and the manifest's entries for its instances."""


def make_shards(
    config: CaptureConfig,
    directory: Path,
    jobs: list[ShardJob],
    workers: int,
    on_error: str = "stop",
    frames_at_once: int | None = None,
) -> Generator[Result, None, None]:
    """Yields the result of each shard of `jobs` once it is written, in any order."""
    of_process = config, directory, on_error, frames_at_once
    try:
        if workers == 1 or len(jobs) == 1:
            photographer = _Photographer(*of_process)
            for job in jobs:
                yield photographer.make(job)
        elif jobs:
            yield from _run_processes(of_process, jobs, min(workers, len(jobs)))
    except BrokenProcessPool as error:
        raise CaptureError(
            f"a process that rendered for {directory} was killed, perhaps for want of memory; the same command goes "
            "on, and workers=1 needs less"
        ) from error


def _run_processes(
    of_process: tuple[CaptureConfig, Path, str, int | None], jobs: list[ShardJob], workers: int
) -> Generator[Result, None, None]:
    context = multiprocessing.get_context("spawn")  # a forked copy of a Vulkan device does not work
    # One executor a process, so that an instance's shards go to the process that has made its mesh already.
    executors = [
        ProcessPoolExecutor(1, mp_context=context, initializer=_start_worker, initargs=of_process)
        for _ in range(workers)
    ]
    groups = [deque(group) for _, group in groupby(jobs, key=lambda job: job.members)]
    waiting = deque(groups[workers:])
    lanes: list[deque[ShardJob]] = [*groups[:workers], *(deque[ShardJob]() for _ in range(workers - len(groups)))]
    running: dict[Future[Result], int] = {}
    try:
        for lane in 2 * list(range(workers)):  # two jobs each: never idle, and little to wait for after Ctrl-C
            _submit_next(lane, executors, lanes, waiting, running)
        while running:
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                lane = running.pop(future)
                _submit_next(lane, executors, lanes, waiting, running)
                yield future.result()
    finally:
        for executor in executors:
            executor.shutdown(wait=False, cancel_futures=True)
        for executor in executors:
            executor.shutdown(wait=True)


def _submit_next(
    lane: int,
    executors: list[ProcessPoolExecutor],
    lanes: list[deque[ShardJob]],
    waiting: deque[deque[ShardJob]],
    running: dict[Future[Result], int],
) -> None:
    """Gives the process `lane` its instance's next shard, else the next instance, else half of the longest lane."""
    if not lanes[lane] and waiting:
        lanes[lane] = waiting.popleft()
    if not lanes[lane]:
        longest = max(lanes, key=len)
        lanes[lane] = deque(longest.pop() for _ in range(len(longest) // 2))
    if lanes[lane]:
        running[executors[lane].submit(_make_in_worker, lanes[lane].popleft())] = lane


class _Photographer:
    """Makes shards in one process, one scene for all of them."""

    def __init__(self, config: CaptureConfig, directory: Path, on_error: str, frames_at_once: int | None) -> None:
        self._config = config
        self._directory = directory
        self._on_error = on_error
        self._source = open_source(config)
        self._scenario = open_scenario(config, frames_at_once)

    def make(self, job: ShardJob) -> Result:
        """Capture the samples of `job` and write its shard.

        An instance that cannot be had is left out where on_error is "skip"; else ObjectError or CaptureError names it.
        """
        subjects, entries, skipped = [], [], {}
        for member in job.members:
            class_name = self._source.classes[member.class_index]
            entry = instance_entry(self._source, class_name, member.number_in_class)
            name = entry["name"]
            try:
                model = self._source.load(class_name, member.number_in_class)
            except ObjectError as error:
                if self._on_error == "stop":
                    raise ObjectError(f"{error}. {_GO_ON}") from error
                skipped[f"{class_name}/{name}"] = str(error)
            else:
                subjects.append(Subject(model, member.class_index, member.instance_index))
                entry["extents_m"] = [round(float(size), 5) for size in model.extents]
                entry["mesh_sha256"] = _mesh_hash(model)
            entries.append(entry)
        captured = self._scenario.capture(subjects, job.first, job.count)
        for name, why in captured.given_up.items():
            if self._on_error == "stop":
                raise CaptureError(f"{name}: {why}. {_GO_ON}")
            skipped[name] = why
        record = write_shard(self._directory / shard_name(job.index), captured.samples)
        return replace(record, rejected=dict(sorted(captured.rejected.items())), skipped=skipped), entries


_photographer: _Photographer | None = None


def _start_worker(config: CaptureConfig, directory: Path, on_error: str, frames_at_once: int | None) -> None:
    global _photographer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process: the parent ends the work
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _photographer = _Photographer(config, directory, on_error, frames_at_once)


def _end_with_parent() -> None:
    """A parent killed with -9 cannot stop its workers, which would wait for jobs for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def _make_in_worker(job: ShardJob) -> Result:
    assert _photographer is not None
    return _photographer.make(job)


def _mesh_hash(model: ObjectModel) -> str:
    digest = hashlib.sha256()
    for part in model.parts:
        digest.update(np.ascontiguousarray(part.vertices, np.float32).tobytes())
        digest.update(np.ascontiguousarray(part.faces, np.int32).tobytes())
    return digest.hexdigest()
