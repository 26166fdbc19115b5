"""From a configuration to a data set on disk: sharded, resumable, the same bytes from any number of processes and jobs.

A shard is a fixed range of the samples of an instance, or of those that share a table, decided by the configuration
alone, and every sample draws from its own seed. So it does not matter which process makes which shard, in which order,
or how often the run was stopped in between: whatever a manifest lists is whole, and the rest is made when the same
command is given again.

Jobs that share the work (`share`) each write their shards into the same folder, or into copies of it that are laid over
each other later, and list them in a manifest of their own. The same command without `share` merges: it takes over what
those manifests list, makes what is missing, and leaves the one manifest that a single run would have left.
"""

from __future__ import annotations

import errno
import hashlib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pec.common.run_identity import first_difference
from pec.data.dataset import CloudDataset
from pec.data.shards import MANIFEST_NAME, Manifest, ShardRecord, read_manifest, read_shard, shard_name, write_manifest
from pec.data.splits import write_splits
from pec.errors import DatasetError
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.shard_plan import allot, open_source
from pecgrasp_env.capture.workers import make_shards, prepare
from pecgrasp_env.common.job_share import JobShare

__all__ = ["Generation", "generate"]

_PARTS = MANIFEST_NAME.replace(".json", ".*of*.json")


@dataclass(frozen=True)
class Generation:
    """What a call of `generate` did."""

    directory: Path
    n_samples: int
    """Samples of the data set that are there, those of other jobs included."""
    n_new: int
    """Those that this call made; the others were there."""
    rejected: dict[str, int]
    """Draws that were not kept, by reason, over all that is there."""
    skipped: dict[str, str]
    """Instances that could not be captured, and why."""
    mended: dict[str, str]
    """What was mended in instances' meshes, or is missing beside them."""
    seconds: float
    manifest: Manifest


def generate(
    config: CaptureConfig,
    directory: str | os.PathLike[str],
    *,
    workers: int = 2,
    on_error: str = "stop",
    share: JobShare | None = None,
    frames_at_once: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    preparing: Callable[[int, int], None] | None = None,
) -> Generation:
    """Make the data set that `config` describes in `directory`, or what is missing of it.

    workers: processes that render; 1 renders in this process. on_error: "stop" at an object that cannot be captured, or
    "skip" it, and say so in the manifest. share: make only this share of the shards. frames_at_once: frames that each
    process draws together, by ManiSkill's batch on a GPU; None: many where there is a GPU, else one. The same bytes are
    promised for one. progress(done, total), in samples, is called once at the start and after each shard; preparing
    likewise, in meshes, while a folder's meshes are cut into convex parts, `workers` at once.
    Raises CaptureError (an object that cannot be captured, a disk that cannot be written), ObjectError (unknown class,
    broken mesh), and DatasetError where `directory` holds another data set. After any of them, Ctrl-C or kill -9, the
    same call goes on where it stopped.
    """
    if workers < 1:
        raise CaptureError(f"workers must be at least 1, got {workers}")
    if frames_at_once is not None and frames_at_once < 1:
        raise CaptureError(f"frames_at_once must be at least 1, or null for what the machine has, got {frames_at_once}")
    if on_error not in ("stop", "skip"):
        raise CaptureError(f"on_error must be stop or skip, got {on_error!r}")
    directory = Path(directory)
    started = time.monotonic()
    source = open_source(config)
    empty, jobs = allot(config, source)
    there = _merged(directory, empty, on_error)
    instances = {_key(instance): instance for instance in there.instances}
    done = {record.file: record for record in there.shards}
    mine = list(jobs) if share is None else list(share.of(jobs))
    names = {shard_name(job.index) for job in mine}
    missing = [job for job in mine if shard_name(job.index) not in done]
    prepare(source, missing, workers, on_error, preparing)
    total = sum(job.n_samples for job in mine)
    n_new = 0
    if progress:
        progress(total - sum(job.n_samples for job in missing), total)

    def listed() -> Manifest:
        """The manifest of the whole, or of this share, as far as it has come."""
        shards = sorted((r for r in done.values() if r.file in names), key=lambda record: record.file)
        return replace(there, instances=list(instances.values()), shards=shards, complete=False)

    manifest_name = MANIFEST_NAME if share is None else MANIFEST_NAME.replace(".json", f"{share.suffix}.json")
    shards = make_shards(config, source, directory, missing, workers, on_error, frames_at_once)
    with _writing(directory), closing(shards) as results:
        for record, entries in results:
            for entry in entries:
                _add_instance(instances, entry, directory)
            done[record.file] = record
            n_new += record.n_samples
            write_manifest(directory, listed(), manifest_name)
            missing_of_mine = sum(job.n_samples for job in mine if shard_name(job.index) not in done)
            if progress:
                progress(total - missing_of_mine, total)
    with _writing(directory):
        manifest = _finish(directory, listed()) if share is None else listed()
        if share is not None:
            write_manifest(directory, manifest, manifest_name)
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    skipped = {name: why for record in manifest.shards for name, why in record.skipped.items()}
    mended = {f"{i['class']}/{i['name']}": "; ".join(i["mended"]) for i in manifest.instances if "mended" in i}
    n_samples = sum(record.n_samples for record in manifest.shards)
    seconds = time.monotonic() - started
    return Generation(directory, n_samples, n_new, dict(rejected.most_common()), skipped, mended, seconds, manifest)


def _finish(directory: Path, manifest: Manifest) -> Manifest:
    """Writes the splits, then says that the data set is complete, then removes the shares' manifests."""
    complete = replace(manifest, complete=True)
    path = directory / MANIFEST_NAME
    if not path.is_file() or read_manifest(directory) != complete:
        shards = [read_shard(directory / record.file, mapped=False) for record in manifest.shards]
        labels = np.concatenate([shard.class_index for shard in shards]).astype(np.int64)
        belong = np.concatenate([shard.instance_index for shard in shards]).astype(np.int64)
        official = None
        if all("split" in instance for instance in manifest.instances):
            official = np.array([instance["split"] == "test" for instance in manifest.instances])[belong]
        write_splits(directory, CloudDataset(manifest.classes, [], labels, belong, ""), manifest.seed, official)
        write_manifest(directory, complete)
    for path in directory.glob(_PARTS):
        path.unlink()
    return complete


def _merged(directory: Path, empty: Manifest, on_error: str) -> Manifest:
    """`empty` with the sound shards that the manifests in `directory` list."""
    instances = {_key(instance): instance for instance in empty.instances}
    records: dict[str, ShardRecord] = {}
    for path in [directory / MANIFEST_NAME, *sorted(directory.glob(_PARTS))]:
        if not path.is_file():
            continue
        found = read_manifest(directory, path.name)
        _check_same(path, found, empty)
        for instance in found.instances:
            _add_instance(instances, instance, directory)
        # Who does not want objects to be skipped wants those tried again that were.
        records |= {record.file: record for record in found.shards if on_error == "skip" or not record.skipped}
    sound = [record for record in records.values() if _is_sound(directory / record.file, record)]
    return replace(empty, instances=list(instances.values()), shards=sound)


def _add_instance(instances: dict[tuple[str, str], dict[str, Any]], entry: dict[str, Any], directory: Path) -> None:
    """Takes over what a shard's maker says of an instance. Raises DatasetError where its mesh has changed."""
    known = instances[_key(entry)]
    if "mesh_sha256" not in entry:
        return
    if known.get("mesh_sha256", entry["mesh_sha256"]) != entry["mesh_sha256"]:
        raise DatasetError(
            f"{directory} holds clouds of another {entry['name']}: its mesh has changed since. "
            "Give another out=, or remove that folder"
        )
    instances[_key(entry)] = entry


def _key(instance: Mapping[str, Any]) -> tuple[str, str]:
    return instance["class"], instance["name"]


def _check_same(path: Path, found: Manifest, wanted: Manifest) -> None:
    before, now = (
        {name: getattr(manifest, name) for name in ("config", "seed", "classes", "cameras", "generator")}
        | {"instances": [_key(instance) for instance in manifest.instances]}
        for manifest in (found, wanted)
    )
    if difference := first_difference(before, now):
        raise DatasetError(
            f"{path} is of another data set, with {difference}: give another out=, or remove that folder"
        )


def _is_sound(path: Path, record: ShardRecord) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == record.sha256


@contextmanager
def _writing(directory: Path) -> Iterator[None]:
    """Turns the operating system's errors into one that says what to do."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            where = error.filename or directory
            raise CaptureError(
                f"the disk is full: {where} could not be written. Free some space; what is whole in {directory} is "
                "kept, and the same command goes on"
            ) from error
        raise CaptureError(f"cannot write the data set in {directory}: {error}; the same command goes on") from error
