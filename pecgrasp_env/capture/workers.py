"""Makes shards: in this process, or in several of them that each render on one core."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Generator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic

import numpy as np

from pec.data.shards import CloudSample, ShardRecord, shard_name, write_shard
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.scenarios import open_scenario
from pecgrasp_env.capture.scenarios.base import Sample, Scenario, Subject
from pecgrasp_env.capture.shard_plan import ShardJob, instance_entry
from pecgrasp_env.capture.source import Source
from pecgrasp_env.capture.with_strangers import WithStrangers
from pecgrasp_env.common.render_pool import run_jobs
from pecgrasp_env.objects import ObjectError, ObjectModel
from pecgrasp_env.objects.deform import Deformed
from pecgrasp_env.objects.mesh_folder import MeshFolder, MeshWarning

__all__ = ["Kind", "Result", "clouds", "make_shards", "prepare"]

_GO_ON = "on_error=skip goes on with the other objects"


Result = tuple[ShardRecord, list[dict[str, Any]]]
"""A written shard, and the manifest's entries for its instances."""


@dataclass(frozen=True)
class Kind(Generic[Sample]):
    """What shards hold. open_scenario: called once in each process. write: a shard's file, as `write_shard` does."""

    open_scenario: Callable[[], Scenario[Sample]]
    write: Callable[[Path, Sequence[Sample]], ShardRecord]
    suffix: str


def clouds(config: CaptureConfig, frames_at_once: int | None) -> Kind[CloudSample]:
    """Shards of labelled clouds; frames_at_once as in `generate`."""
    return Kind(partial(open_scenario, config, frames_at_once), write_shard, ".safetensors")


def check_words(workers: int, on_error: str) -> None:
    """Raises CaptureError where there are no workers, or it is neither to stop nor to skip."""
    if workers < 1:
        raise CaptureError(f"workers must be at least 1, got {workers}")
    if on_error not in ("stop", "skip"):
        raise CaptureError(f"on_error must be stop or skip, got {on_error!r}")


def make_shards(
    kind: Kind[Sample], source: Source, directory: Path, jobs: list[ShardJob], workers: int, on_error: str = "stop"
) -> Generator[Result, None, None]:
    """Yields the result of each shard of `jobs` once it is written, in any order."""
    make_worker = partial(_ShardMaker, kind, source, directory, on_error)
    try:
        # An instance's shards go to one process, which makes its mesh once.
        yield from run_jobs(make_worker, jobs, workers, same_process=lambda job: job.members)
    except BrokenProcessPool as error:
        raise CaptureError(
            f"a process that rendered for {directory} was killed, perhaps for want of memory; the same command goes "
            "on, and workers=1 needs less"
        ) from error


def prepare(
    source: Source,
    jobs: Sequence[ShardJob],
    workers: int,
    on_error: str,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Cut the meshes that the jobs need into convex parts, `workers` at once.

    progress(done, total), in meshes. Raises ObjectError that names all that cannot be used where on_error is "stop".
    """
    members = {(source.classes[m.class_index], m.number_in_class): None for job in jobs for m in job.members}
    if isinstance(source, WithStrangers):
        drawn = [one for one in members if source.is_drawn(*one)]
        members = {one: None for one in members if one not in drawn}
        members |= dict.fromkeys(source.models_near() if drawn else ())
        source = source.base
    if isinstance(source, Deformed):
        members = {(name, source.original(name, i)[0]): None for name, i in members}
        source = source.base
    if not isinstance(source, MeshFolder):
        return
    errors = source.prepare(list(members), workers, progress)
    if errors and on_error == "stop":
        several = f"{len(errors)} of {len(members)} meshes cannot be used:\n" if len(errors) > 1 else ""
        raise ObjectError(f"{several}{chr(10).join(map(str, errors.values()))}. {_GO_ON}")


class _ShardMaker(Generic[Sample]):
    """Makes shards in one process, one scene for all of them."""

    def __init__(self, kind: Kind[Sample], source: Source, directory: Path, on_error: str) -> None:
        self._kind = kind
        self._directory = directory
        self._on_error = on_error
        self._source = source
        self._scenario = kind.open_scenario()

    def run(self, job: ShardJob) -> Result:
        """Capture the samples of `job` and write its shard.

        An instance that cannot be had is left out where on_error is "skip"; else ObjectError or CaptureError names it.
        """
        subjects: list[Subject] = []
        entries: list[dict[str, Any]] = []
        skipped: dict[str, str] = {}
        drawn: dict[str, int] = {}  # places among the entries, by name
        for member in job.members:
            class_name = self._source.classes[member.class_index]
            entry = instance_entry(self._source, class_name, member.number_in_class)
            name = entry["name"]
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", MeshWarning)  # the entry says it
                    model = self._source.load(class_name, member.number_in_class)
            except ObjectError as error:
                if self._on_error == "stop":
                    raise ObjectError(f"{error}. {_GO_ON}") from error
                skipped[f"{class_name}/{name}"] = str(error)
            else:
                subjects.append(Subject(model, member.class_index, member.instance_index))
                entry["extents_m"] = [round(float(size), 5) for size in model.extents]
                entry["mesh_sha256"] = _mesh_hash(model)
                if model.mended:
                    entry["mended"] = list(model.mended)
            if isinstance(self._source, WithStrangers) and self._source.is_drawn(class_name, member.number_in_class):
                drawn[f"{class_name}/{name}"] = len(entries)
            entries.append(entry)
        captured = self._scenario.capture(subjects, job.first, job.count)
        for name, why in captured.given_up.items():
            if name in drawn:
                entries[drawn[name]]["not_captured"] = why  # another would do as well: no reason to stop
                continue
            if self._on_error == "stop":
                raise CaptureError(f"{name}: {why}. {_GO_ON}")
            skipped[name] = why
        record = self._kind.write(self._directory / shard_name(job.index, self._kind.suffix), captured.samples)
        return replace(record, rejected=dict(sorted(captured.rejected.items())), skipped=skipped), entries

    def close(self) -> None:
        """Nothing to do: the scene goes with the last reference to it."""


def _mesh_hash(model: ObjectModel) -> str:
    digest = hashlib.sha256()
    for part in model.parts:
        digest.update(np.ascontiguousarray(part.vertices, np.float32).tobytes())
        digest.update(np.ascontiguousarray(part.faces, np.int32).tobytes())
    return digest.hexdigest()
