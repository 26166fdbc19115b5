"""From a configuration to a set of labelled frames on disk: sharded, resumable, the same bytes from any workers."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Generator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pec.data.shards import Manifest, ShardRecord, shard_name
from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.capture.resume import make_missing
from pecgrasp_env.capture.scenes.config import CAMERAS, FramesConfig
from pecgrasp_env.capture.scenes.frames import write_frames
from pecgrasp_env.capture.scenes.maker import SceneMaker
from pecgrasp_env.capture.scenes.object_pool import ObjectPool
from pecgrasp_env.capture.shard_plan import made_by
from pecgrasp_env.common.job_share import JobShare
from pecgrasp_env.common.render_pool import run_jobs

__all__ = ["FramesGeneration", "generate_frames"]

_SUFFIX = ".npz"


@dataclass(frozen=True)
class FramesGeneration:
    """What a call of `generate_frames` did: frames that are there, those of them made now, and draws made anew."""

    directory: Path
    manifest: Manifest
    n_frames: int
    n_new: int
    rejected: dict[str, int]
    seconds: float


@dataclass(frozen=True)
class _Job:
    """One shard: scenes `first` to `first + count`."""

    index: int
    first: int
    count: int
    n_samples: int


def generate_frames(
    config: FramesConfig,
    directory: str | os.PathLike[str],
    *,
    workers: int = 2,
    share: JobShare | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> FramesGeneration:
    """Make the frames that `config` describes in `directory`, or what is missing of them.

    workers: processes that render; 1 renders in this process. share: make only this share of the shards; without it the
    same command merges. progress(done, total), in frames, is called once at the start and after each shard.
    Raises CaptureError (a scene that never comes to rest, a disk that cannot be written), ObjectError (a mesh folder
    that is missing or empty) and DatasetError where `directory` holds another data set. After any of them, Ctrl-C or
    kill -9, the same call goes on where it stopped.
    """
    if workers < 1:
        raise CaptureError(f"workers must be at least 1, got {workers}")
    directory = Path(directory)
    started = time.monotonic()
    cameras = [{"name": name, **asdict(CAMERAS[name])} for name in config.cameras]
    classes = list(ObjectPool(config.objects).classes)
    empty = Manifest(classes, [], cameras, config.described(), config.seed, made_by())
    jobs: list[_Job] = []
    for first in range(0, config.scenes, config.shard_size):
        count = min(config.shard_size, config.scenes - first)
        jobs.append(_Job(len(jobs), first, count, count * config.frames_per_scene))

    def make(missing: list[_Job]) -> Generator[tuple[ShardRecord, list[dict[str, Any]]], None, None]:
        try:
            yield from run_jobs(partial(_FrameShardMaker, config, directory), missing, workers)
        except BrokenProcessPool as error:
            raise CaptureError(
                f"a process that rendered for {directory} was killed, perhaps for want of memory; the same command "
                "goes on, and workers=1 needs less"
            ) from error

    manifest, n_new = make_missing(
        directory, empty, jobs, make, share=share, finish=lambda *_: None, suffix=_SUFFIX, progress=progress
    )
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    n_frames = sum(record.n_samples for record in manifest.shards)
    return FramesGeneration(directory, manifest, n_frames, n_new, dict(rejected), time.monotonic() - started)


class _FrameShardMaker:
    """Makes shards in one process."""

    def __init__(self, config: FramesConfig, directory: Path) -> None:
        self._maker = SceneMaker(config)
        self._directory = directory

    def run(self, job: _Job) -> tuple[ShardRecord, list[dict[str, Any]]]:
        rejected: Counter[str] = Counter()
        frames = [
            frame for scene in range(job.first, job.first + job.count) for frame in self._maker.frames(scene, rejected)
        ]
        record = write_frames(self._directory / shard_name(job.index, _SUFFIX), frames)
        return replace(record, rejected=dict(sorted(rejected.items()))), []

    def close(self) -> None:
        """Nothing to do: the scene goes with the last reference to it."""
