"""Makes shards: in this process, or in several of them that each render on one core."""

from __future__ import annotations

import hashlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pec.shards import ShardRecord, shard_name, write_shard
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.samples import Subject
from pecgrasp_env.objects import LARS_CLASSES, Catalogue, ObjectError, ObjectModel
from pecgrasp_env.objects.mesh_folder import MeshFolder
from pecgrasp_env.objects.modelnet import ModelNetArchive
from pecgrasp_env.objects.ycb import YcbDownload, YcbLookAlikes, find_models

if TYPE_CHECKING:
    from pecgrasp_env.capture.samples import Scenario

__all__ = ["Member", "Result", "ShardJob", "Source", "instance_entry", "make_shards", "open_scenario", "open_source"]


_GPU_FRAMES = 64
"""Sub-scenes of ManiSkill's batch: at 848x480 half a gigabyte of pictures."""

_GO_ON = "on_error=skip goes on with the other objects"


@dataclass(frozen=True)
class Member:
    """An instance: its indices in the manifest, and its number among those of its class."""

    class_index: int
    instance_index: int
    number_in_class: int


@dataclass(frozen=True)
class ShardJob:
    """One shard: samples `first` to `first + count` of each of its members."""

    index: int
    members: tuple[Member, ...]
    first: int
    count: int

    @property
    def n_samples(self) -> int:
        return self.count * len(self.members)


Result = tuple[ShardRecord, list[dict[str, Any]]]
"""A written shard, and the manifest's entries for its instances."""


def instance_entry(source: Source, class_name: str, number: int) -> dict[str, Any]:
    """What the manifest says of an instance before it is captured."""
    entry = {
        "name": source.names(class_name)[number],
        "class": class_name,
        "origin": source.origin(class_name, number),
    }
    if isinstance(source, ModelNetArchive):
        entry["split"] = source.split(class_name, number)
    return entry


class Source(Protocol):
    """Where objects come from: classes, and instances of each, in a fixed order."""

    classes: tuple[str, ...]

    def names(self, class_name: str) -> list[str]: ...
    def load(self, class_name: str, i: int) -> ObjectModel: ...
    def origin(self, class_name: str, i: int) -> str: ...


def open_source(config: CaptureConfig) -> Source:
    """The objects that `config` names. Raises ObjectError for an unknown class, an empty or missing folder."""
    objects = config.objects
    if objects.path is not None and objects.source == "modelnet10":
        return ModelNetArchive(objects.path, objects.classes)
    if objects.path is not None and objects.source == "ycb" and (models := find_models(objects.path)):
        return YcbDownload(objects.classes, objects.seed, models)
    if objects.path is not None:
        return MeshFolder(objects.path, objects.scale, objects.classes, objects.allow_open)
    if objects.source == "ycb" and objects.download:
        return YcbDownload(objects.classes, objects.seed)
    if objects.source == "ycb":
        return YcbLookAlikes(objects.classes, objects.instances_per_class, objects.seed)
    return Catalogue(objects.classes or LARS_CLASSES, objects.instances_per_class or 20, objects.seed)


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


def open_scenario(config: CaptureConfig, frames_at_once: int | None = None) -> Scenario:
    """What captures objects as `config` says, in this process; frames_at_once as in `generate`."""
    # Imported here, as they load Vulkan: in the process that renders only.
    if config.scenario == "surface":
        from pecgrasp_env.capture.surface import SurfaceScenario

        return SurfaceScenario(config)
    from pecgrasp_env.capture.studio import DepthStudio, Studio, gpu_draws

    open_studio: Callable[[float], Studio] = DepthStudio
    if frames_at_once is None:
        frames_at_once = _GPU_FRAMES if gpu_draws() else 1
    if frames_at_once > 1:
        from pecgrasp_env.capture.batch import BatchStudio

        open_studio = partial(BatchStudio, cameras=config.intrinsics, at_once=frames_at_once)
    if config.scenario == "tabletop":
        from pecgrasp_env.capture.tabletop import TabletopScenario

        return TabletopScenario(config, open_studio)
    from pecgrasp_env.capture.free import FreeScenario

    return FreeScenario(config, open_studio)


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
