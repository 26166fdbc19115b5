"""Jobs that render, over processes: each has one renderer, made once, and results come as they are complete."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Hashable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import closing
from functools import cache
from itertools import groupby
from typing import Any, Generic, Protocol, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")
Job_contra = TypeVar("Job_contra", contravariant=True)
Result_co = TypeVar("Result_co", covariant=True)


class Worker(Protocol[Job_contra, Result_co]):
    """What does the jobs of one process, one after another."""

    def run(self, job: Job_contra, /) -> Result_co: ...

    def close(self) -> None: ...


def run_jobs(
    make_worker: Callable[[], Worker[Job, Result]],
    jobs: Sequence[Job],
    workers: int,
    same_process: Callable[[Job], Hashable] | None = None,
) -> Generator[Result, None, None]:
    """Yields each job's result as it is complete, in any order; close it to cancel what has not begun.

    Args:
        make_worker: called once in each process; it, jobs and results must be picklable.
        jobs: what is done.
        workers: processes. With one of them, or one job, all happens in this process, in the order of the jobs.
        same_process: neighbours for which it is equal go to one process, which may keep what they share, as long as
            the other processes have work.

    Raises what a job or `make_worker` raises; BrokenProcessPool where a process was killed.
    """
    workers = min(workers, len(jobs))
    if workers == 0:
        return
    if workers == 1:
        with closing(make_worker()) as worker:
            for job in jobs:
                yield worker.run(job)
        return
    groups = (
        [[job] for job in jobs] if same_process is None else [list(same) for _, same in groupby(jobs, same_process)]
    )
    queue = _Queue(groups, workers)
    # One core a process: Mesa's software driver would start a thread for each core in all of them.
    os.environ.setdefault("LP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))
    context = multiprocessing.get_context("spawn")  # a forked copy of a Vulkan device does not work
    # One executor a process, as no other would let choose which process gets a job.
    executors = [ProcessPoolExecutor(1, context, _start_process, (make_worker,)) for _ in range(workers)]
    running: dict[Future[Result], int] = {}

    def submit_next(process: int) -> None:
        if len(queue):
            running[executors[process].submit(_run_in_process, queue.next_of(process))] = process

    try:
        for process in range(workers):
            submit_next(process)
        for process in range(workers):  # a second job each, never to be idle; the last ones go to whoever is free
            if len(queue) > workers:
                submit_next(process)
        while running:
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                process = running.pop(future)
                if len(queue) > workers or process not in running.values():
                    submit_next(process)
                yield future.result()
    finally:
        for executor in executors:
            executor.shutdown(wait=False, cancel_futures=True)
        for executor in executors:
            executor.shutdown(wait=True)


class _Queue(Generic[Job]):
    """Groups of jobs, handed out so that a group stays with one process until the others run out of work."""

    def __init__(self, groups: Sequence[Sequence[Job]], processes: int) -> None:
        self._groups = deque(deque(group) for group in groups)
        self._of_process: list[deque[Job]] = [deque() for _ in range(processes)]

    def __len__(self) -> int:
        return sum(map(len, self._groups)) + sum(map(len, self._of_process))

    def next_of(self, process: int) -> Job:
        """Its group's next job, else the first of the next group, else of half of what another process has most of."""
        if not self._of_process[process] and self._groups:
            self._of_process[process] = self._groups.popleft()
        if not self._of_process[process]:
            longest = max(self._of_process, key=len)
            self._of_process[process] = deque(longest.pop() for _ in range((len(longest) + 1) // 2))
        return self._of_process[process].popleft()


_make_worker: Callable[[], Worker[Any, Any]]
"""Of a process of the pool."""


def _start_process(make_worker: Callable[[], Worker[Any, Any]]) -> None:
    global _make_worker
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:  # as a shell's background jobs have it
        signal.signal(signal.SIGINT, lambda *_: sys.exit(1))  # Ctrl-C reaches all: a job cleans up, nothing is printed
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _make_worker = make_worker


@cache
def _worker() -> Worker[Any, Any]:
    """Made by the first job and not before, so that what it fails of is that job's error."""
    return _make_worker()


def _run_in_process(job: Any) -> Any:
    try:
        return _worker().run(job)
    except SystemExit:  # of Ctrl-C
        os._exit(1)  # else the process would begin the job that waits for it


def _end_with_parent() -> None:
    """A parent killed with -9 cannot stop its workers, which would wait for jobs for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
