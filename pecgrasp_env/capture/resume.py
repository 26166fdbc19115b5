"""Whatever of a data set is missing, made: sharded work that goes on where it was stopped, and merges what jobs made.

A shard is a fixed share of a data set that the configuration alone decides. What a manifest lists is whole, for a shard
is listed only once it lies on the disk; the rest is made when the same command is given again. Jobs that share the work
(`JobShare`) list their shards in manifests of their own, which the command without a share takes over.
"""

from __future__ import annotations

import errno
import hashlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from pec.common.run_identity import first_difference
from pec.data.shards import MANIFEST_NAME, Manifest, ShardRecord, read_manifest, shard_name, write_manifest
from pec.errors import DatasetError
from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.common.job_share import JobShare

__all__ = ["make_missing"]

_PARTS = MANIFEST_NAME.replace(".json", ".*of*.json")


class Job(Protocol):
    """One shard's work."""

    @property
    def index(self) -> int: ...
    @property
    def n_samples(self) -> int: ...


AnyJob = TypeVar("AnyJob", bound=Job)


def make_missing(
    directory: Path,
    empty: Manifest,
    jobs: Sequence[AnyJob],
    make: Callable[[list[AnyJob]], Generator[tuple[ShardRecord, list[dict[str, Any]]], None, None]],
    *,
    finish: Callable[[Path, Manifest], None],
    share: JobShare | None = None,
    keep_skipped: bool = False,
    suffix: str = ".safetensors",
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Manifest, int]:
    """Make the shards that are not there yet.

    Args:
        directory: of the data set.
        empty: its manifest without shards.
        jobs: all of its shards.
        make: writes the shards of the jobs it is given and yields, in any order, the record of each and what its maker
            says of the manifest's instances.
        finish: called with the whole data set before its manifest says that it is complete.
        share: make only this share of the jobs.
        keep_skipped: take shards as they are that were made without some instances.
        suffix: of the shards' names.
        progress: called with (done, total) samples at the start and after each shard.

    Returns:
        The manifest of the data set, or of this share of it, and how many samples were made now.

    Raises:
        DatasetError: the directory holds another data set.
        CaptureError: the disk cannot be written.
    """
    there = _merged(directory, empty, keep_skipped)
    instances = {_key(instance): instance for instance in there.instances}
    done = {record.file: record for record in there.shards}
    mine = list(jobs) if share is None else list(share.of(jobs))
    names = {shard_name(job.index, suffix) for job in mine}
    missing = [job for job in mine if shard_name(job.index, suffix) not in done]
    total = sum(job.n_samples for job in mine)
    n_new = 0

    def listed() -> Manifest:
        """The manifest of the whole, or of this share, as far as it has come."""
        shards = sorted((r for r in done.values() if r.file in names), key=lambda record: record.file)
        return replace(there, instances=list(instances.values()), shards=shards, complete=False)

    manifest_name = MANIFEST_NAME if share is None else MANIFEST_NAME.replace(".json", f"{share.suffix}.json")
    shards = make(missing)
    if progress:
        progress(total - sum(job.n_samples for job in missing), total)
    with _writing(directory), closing(shards) as results:
        for record, entries in results:
            for entry in entries:
                _add_instance(instances, entry, directory)
            done[record.file] = record
            n_new += record.n_samples
            write_manifest(directory, listed(), manifest_name)
            missing_of_mine = sum(job.n_samples for job in mine if shard_name(job.index, suffix) not in done)
            if progress:
                progress(total - missing_of_mine, total)
    with _writing(directory):
        manifest = _finish(directory, listed(), finish) if share is None else listed()
        if share is not None:
            write_manifest(directory, manifest, manifest_name)
    return manifest, n_new


def _finish(directory: Path, manifest: Manifest, finish: Callable[[Path, Manifest], None]) -> Manifest:
    """Finishes, then says that the data set is complete, then removes the shares' manifests."""
    complete = replace(manifest, complete=True)
    path = directory / MANIFEST_NAME
    if not path.is_file() or read_manifest(directory) != complete:
        finish(directory, manifest)
        write_manifest(directory, complete)
    for path in directory.glob(_PARTS):
        path.unlink()
    return complete


def _merged(directory: Path, empty: Manifest, keep_skipped: bool) -> Manifest:
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
        records |= {record.file: record for record in found.shards if keep_skipped or not record.skipped}
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
