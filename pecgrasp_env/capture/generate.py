"""From a configuration to a data set on disk: sharded, resumable, the same bytes from any number of processes.

A shard is a fixed range of one instance's samples, decided by the configuration alone, and every sample draws from its
own seed. So it does not matter which process makes which shard, in which order, or how often the run was stopped in
between: whatever the manifest lists is whole, and the rest is made when the same command is given again.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pec.errors import DatasetError
from pec.shards import MANIFEST_NAME, Manifest, ShardRecord, read_manifest, shard_name, write_manifest, write_shard
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.objects import LARS_CLASSES, Catalogue, ObjectModel

if TYPE_CHECKING:
    from pecgrasp_env.capture.free import FreeScenario

__all__ = ["Generation", "generate"]

_PACKAGES = ("pecgrasp", "sapien", "numpy", "scipy")
"""What decides the bytes of a sample."""


@dataclass(frozen=True)
class Generation:
    """What a call of `generate` did."""

    directory: Path
    n_samples: int
    """Samples in the data set."""
    n_new: int
    """Those that this call made; the others were there."""
    rejected: dict[str, int]
    """Draws that were not kept, by reason, over the whole data set."""
    seconds: float


@dataclass(frozen=True)
class _Job:
    """One shard: samples `first` to `first + count` of one instance."""

    index: int
    class_index: int
    instance_index: int
    number_in_class: int
    """Which instance of its class."""
    first: int
    count: int


def generate(
    config: CaptureConfig,
    directory: str | os.PathLike[str],
    *,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> Generation:
    """Make the data set that `config` describes in `directory`, or what is missing of it.

    workers: processes that render; 1 renders in this process. progress(done, total), in samples, is called once at the
    start and after each shard.
    Raises CaptureError (an object that cannot be captured, a disk that cannot be written), ObjectError (unknown class,
    broken mesh), and DatasetError where `directory` holds another data set. After any of them, Ctrl-C or kill -9, the
    same call goes on where it stopped.
    """
    if workers < 1:
        raise CaptureError(f"workers must be at least 1, got {workers}")
    directory = Path(directory)
    started = time.monotonic()
    manifest, jobs = _plan(config)
    manifest = _resume(directory, manifest)
    done = {record.file: record for record in manifest.shards}
    missing = [job for job in jobs if shard_name(job.index) not in done]
    total = sum(job.count for job in jobs)
    n_new = 0
    if progress:
        progress(total - sum(job.count for job in missing), total)
    with closing(_run(config, directory, missing, workers)) as records:
        for record in records:
            done[record.file] = record
            n_new += record.n_samples
            manifest = replace(manifest, shards=sorted(done.values(), key=lambda r: r.file))
            write_manifest(directory, manifest)
            if progress:
                progress(sum(r.n_samples for r in done.values()), total)
    if not manifest.complete:
        manifest = replace(manifest, complete=True)
        write_manifest(directory, manifest)
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    return Generation(directory, total, n_new, dict(rejected.most_common()), time.monotonic() - started)


def _plan(config: CaptureConfig) -> tuple[Manifest, list[_Job]]:
    """The empty manifest of the data set and all its shards."""
    source = _open(config)
    instances: list[dict[str, Any]] = []
    jobs: list[_Job] = []
    for class_index, class_name in enumerate(source.classes):
        for number, name in enumerate(source.names(class_name)[: config.objects.instances_per_class]):
            model = source.load(class_name, number)
            instances.append(
                {
                    "name": name,
                    "class": class_name,
                    "extents_m": [round(float(size), 5) for size in model.extents],
                    "mesh_sha256": _mesh_hash(model),
                }
            )
            for first in range(0, config.samples_per_instance, config.shard_size):
                count = min(config.shard_size, config.samples_per_instance - first)
                jobs.append(_Job(len(jobs), class_index, len(instances) - 1, number, first, count))
    versions = {package: importlib.metadata.version(package) for package in _PACKAGES}
    described = json.loads(json.dumps({"scenario": "free", **asdict(config), "camera": asdict(config.intrinsics)}))
    return Manifest(list(source.classes), instances, described, config.seed, versions), jobs


def _open(config: CaptureConfig) -> Catalogue:
    objects = config.objects
    return Catalogue(objects.classes or LARS_CLASSES, objects.instances_per_class or 2, objects.seed)


def _mesh_hash(model: ObjectModel) -> str:
    digest = hashlib.sha256()
    for part in model.parts:
        digest.update(np.ascontiguousarray(part.vertices, np.float32).tobytes())
        digest.update(np.ascontiguousarray(part.faces, np.int32).tobytes())
    return digest.hexdigest()


def _resume(directory: Path, planned: Manifest) -> Manifest:
    """`planned` with the shards that are already there and sound."""
    if not (directory / MANIFEST_NAME).is_file():
        return planned
    found = read_manifest(directory)
    for name in ("config", "seed", "classes", "instances", "generator"):
        there, wanted = getattr(found, name), getattr(planned, name)
        if there != wanted:
            raise DatasetError(
                f"{directory} holds another data set: {_difference(name, there, wanted)}. "
                "Give another out=, or remove that folder"
            )
    sound = [record for record in found.shards if _is_sound(directory / record.file, record)]
    return replace(planned, shards=sound, complete=found.complete and len(sound) == len(found.shards))


def _difference(name: str, there: Any, wanted: Any) -> str:
    if isinstance(there, dict) and isinstance(wanted, dict):
        for key in sorted(there.keys() | wanted.keys()):
            if there.get(key) != wanted.get(key):
                return _difference(f"{name}.{key}", there.get(key), wanted.get(key))
    return f"{name} is {there} there, {wanted} here"


def _is_sound(path: Path, record: ShardRecord) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == record.sha256


def _run(config: CaptureConfig, directory: Path, jobs: list[_Job], workers: int) -> Generator[ShardRecord, None, None]:
    """Yields the record of each shard of `jobs` once it is written, in any order."""
    try:
        if workers == 1 or len(jobs) == 1:
            photographer = _Photographer(config, directory)
            for job in jobs:
                yield photographer.make(job)
        elif jobs:
            yield from _run_pool(config, directory, jobs, min(workers, len(jobs)))
    except OSError as error:
        raise CaptureError(f"cannot write the data set in {directory}: {error}; the same command goes on") from error


def _run_pool(
    config: CaptureConfig, directory: Path, jobs: list[_Job], workers: int
) -> Generator[ShardRecord, None, None]:
    # Each process rasterises on one core; Mesa's software driver would start a thread a core in each of them.
    os.environ.setdefault("LP_NUM_THREADS", "1")
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),  # a forked copy of a Vulkan device does not work
        initializer=_start_worker,
        initargs=(config, directory),
    )
    try:
        # Two jobs a worker at a time: never idle, and little to wait for after Ctrl-C.
        queue = iter(jobs)
        running: set[Future[ShardRecord]] = set()
        while True:
            while len(running) < 2 * workers and (job := next(queue, None)) is not None:
                running.add(executor.submit(_make_in_worker, job))
            if not running:
                return
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    except BrokenProcessPool as error:
        raise CaptureError(
            f"a process that rendered for {directory} was killed, perhaps for want of memory; the same command goes "
            "on, and workers=1 needs less"
        ) from error
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


class _Photographer:
    """Makes shards in one process, one scene for all of them."""

    def __init__(self, config: CaptureConfig, directory: Path) -> None:
        from pecgrasp_env.capture.free import FreeScenario  # loads Vulkan: in the process that renders only

        self._config = config
        self._directory = directory
        self._source = _open(config)
        self._scenario: FreeScenario = FreeScenario(config)
        self._shown: tuple[str, int] | None = None

    def make(self, job: _Job) -> ShardRecord:
        """Capture the samples of `job` and write its shard."""
        from pecgrasp_env.capture.free import sample_seed

        class_name = self._source.classes[job.class_index]
        name = self._source.names(class_name)[job.number_in_class]
        if self._shown != (class_name, job.number_in_class):
            self._scenario.show(self._source.load(class_name, job.number_in_class))
            self._shown = class_name, job.number_in_class
        rejected: Counter[str] = Counter()
        samples = [
            self._scenario.capture(
                job.class_index,
                job.instance_index,
                sample_seed(self._config.seed, class_name, name, sample),
                rejected,
            )
            for sample in range(job.first, job.first + job.count)
        ]
        record = write_shard(self._directory / shard_name(job.index), samples)
        return replace(record, rejected=dict(sorted(rejected.items())))


_photographer: _Photographer | None = None


def _start_worker(config: CaptureConfig, directory: Path) -> None:
    global _photographer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process: the parent ends the work
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _photographer = _Photographer(config, directory)


def _end_with_parent() -> None:
    """A parent killed with -9 cannot stop its workers, which would wait for jobs for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def _make_in_worker(job: _Job) -> ShardRecord:
    assert _photographer is not None
    return _photographer.make(job)
