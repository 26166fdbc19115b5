"""From a configuration to grasp labels on disk: sharded, resumable, the same bytes from any workers."""

from __future__ import annotations

import os
import resource
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from pec.data.shards import Manifest
from pec.grasps.labels import write_grasp_shard
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.scenario import GraspScenario
from pecgrasp_env.capture.resume import make_missing
from pecgrasp_env.capture.shard_plan import ShardJob, allot, open_source
from pecgrasp_env.capture.workers import Kind, Result, check_words, make_shards, prepare
from pecgrasp_env.common.job_share import JobShare

__all__ = ["GraspsGeneration", "generate_grasps"]

_SUFFIX = ".npz"


@dataclass(frozen=True)
class GraspsGeneration:
    """What a call of `generate_grasps` did. n_grasps: that are there. n_new: that this call made, in `seconds`, of
    which the processors worked core_seconds. rejected: views that were not kept and grasps that were not found, by
    reason. skipped: objects that could not be had, and why."""

    directory: Path
    manifest: Manifest
    n_grasps: int
    n_new: int
    rejected: dict[str, int]
    skipped: dict[str, str]
    seconds: float
    core_seconds: float


def generate_grasps(
    config: GraspsConfig,
    directory: str | os.PathLike[str],
    *,
    workers: int = 2,
    on_error: str = "stop",
    share: JobShare | None = None,
    progress: Callable[[int, int], None] | None = None,
    preparing: Callable[[int, int], None] | None = None,
) -> GraspsGeneration:
    """Make the grasp labels that `config` describes in `directory`, or what is missing of them.

    workers: processes; 1 works in this one. on_error: "stop" at an object that cannot be had, or "skip" it. share: make
    only this share of the shards; without it the same command merges. progress(done, total), in scenes, is called at
    the start and after each shard; preparing likewise, in meshes, while a folder's meshes are cut into convex parts.
    Raises CaptureError (an object that is never seen, a disk that cannot be written), ObjectError (unknown class,
    broken mesh) and DatasetError where `directory` holds another data set. After any of them, Ctrl-C or kill -9, the
    same call goes on where it stopped.
    """
    check_words(workers, on_error)
    directory = Path(directory)
    started, worked = time.monotonic(), _core_seconds()
    source = open_source(config.capture)
    empty, jobs = allot(config.capture, source)
    empty = replace(empty, config=config.described())
    kind = Kind(partial(GraspScenario, config), write_grasp_shard, _SUFFIX)

    def make(missing: list[ShardJob]) -> Generator[Result, None, None]:
        prepare(source, missing, workers, on_error, preparing)
        return make_shards(kind, source, directory, missing, workers, on_error)

    manifest, n_new = make_missing(
        directory,
        empty,
        jobs,
        make,
        share=share,
        keep_skipped=on_error == "skip",
        finish=lambda *_: None,
        suffix=_SUFFIX,
        progress=progress,
    )
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    skipped = {name: why for record in manifest.shards for name, why in record.skipped.items()}
    n_grasps = sum(record.n_samples for record in manifest.shards)
    seconds, core_seconds = time.monotonic() - started, _core_seconds() - worked
    return GraspsGeneration(
        directory, manifest, n_grasps, n_new, dict(rejected.most_common()), skipped, seconds, core_seconds
    )


def _core_seconds() -> float:
    """Of processor time, of this process and of its children that have ended."""
    times = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in times)
