"""From a configuration to a data set on disk: sharded, resumable, the same bytes from any number of processes.

A shard is a fixed range of one instance's samples, decided by the configuration alone, and every sample draws from its
own seed. So it does not matter which process makes which shard, in which order, or how often the run was stopped in
between: whatever the manifest lists is whole, and the rest is made when the same command is given again.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pec.errors import DatasetError
from pec.shards import MANIFEST_NAME, Manifest, ShardRecord, read_manifest, shard_name, write_manifest
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.workers import ShardJob, make_shards, open_source

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
    planned, jobs = _plan(config)
    manifest = _resume(directory, planned)
    instances = {(instance["class"], instance["name"]): instance for instance in manifest.instances}
    done = {record.file: record for record in manifest.shards}
    missing = [job for job in jobs if shard_name(job.index) not in done]
    total = sum(job.count for job in jobs)
    n_new = 0
    if progress:
        progress(total - sum(job.count for job in missing), total)
    with closing(make_shards(config, directory, missing, workers)) as results:
        for record, instance in results:
            key = instance["class"], instance["name"]
            known = instances[key]
            if known.get("mesh_sha256", instance["mesh_sha256"]) != instance["mesh_sha256"]:
                raise DatasetError(
                    f"{directory} holds clouds of another {instance['name']}: its mesh has changed since. "
                    "Give another out=, or remove that folder"
                )
            instances[key] = instance
            done[record.file] = record
            n_new += record.n_samples
            shards = sorted(done.values(), key=lambda r: r.file)
            manifest = replace(manifest, instances=list(instances.values()), shards=shards)
            write_manifest(directory, manifest)
            if progress:
                progress(sum(r.n_samples for r in done.values()), total)
    if not manifest.complete:
        manifest = replace(manifest, complete=True)
        write_manifest(directory, manifest)
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    return Generation(directory, total, n_new, dict(rejected.most_common()), time.monotonic() - started)


def _plan(config: CaptureConfig) -> tuple[Manifest, list[ShardJob]]:
    """The empty manifest of the data set and all its shards."""
    source = open_source(config)
    instances: list[dict[str, Any]] = []
    jobs: list[ShardJob] = []
    for class_index, class_name in enumerate(source.classes):
        for number, name in enumerate(source.names(class_name)[: config.objects.instances_per_class]):
            instances.append({"name": name, "class": class_name})
            for first in range(0, config.samples_per_instance, config.shard_size):
                count = min(config.shard_size, config.samples_per_instance - first)
                jobs.append(ShardJob(len(jobs), class_index, len(instances) - 1, number, first, count))
    versions = {package: importlib.metadata.version(package) for package in _PACKAGES}
    cameras = [{"name": config.resolution, **asdict(config.intrinsics)}]
    return Manifest(list(source.classes), instances, cameras, config.described(), config.seed, versions), jobs


def _resume(directory: Path, planned: Manifest) -> Manifest:
    """`planned` with the shards that are already there and sound."""
    if not (directory / MANIFEST_NAME).is_file():
        return planned
    found = read_manifest(directory)
    pairs = [
        (name, getattr(found, name), getattr(planned, name)) for name in ("config", "seed", "classes", "generator")
    ]
    pairs.append(("instances", _names(found), _names(planned)))
    for name, there, wanted in pairs:
        if there != wanted:
            raise DatasetError(
                f"{directory} holds another data set: {_difference(name, there, wanted)}. "
                "Give another out=, or remove that folder"
            )
    sound = [record for record in found.shards if _is_sound(directory / record.file, record)]
    return replace(found, shards=sound, complete=found.complete and len(sound) == len(found.shards))


def _names(manifest: Manifest) -> list[str]:
    return [instance["name"] for instance in manifest.instances]


def _difference(name: str, there: Any, wanted: Any) -> str:
    if isinstance(there, dict) and isinstance(wanted, dict):
        for key in sorted(there.keys() | wanted.keys()):
            if there.get(key) != wanted.get(key):
                return _difference(f"{name}.{key}", there.get(key), wanted.get(key))
    return f"{name} is {there} there, {wanted} here"


def _is_sound(path: Path, record: ShardRecord) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == record.sha256
