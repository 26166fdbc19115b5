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

import os
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pec.data.dataset import CloudDataset
from pec.data.shards import Manifest, read_shard
from pec.data.splits import write_splits
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.resume import make_missing
from pecgrasp_env.capture.shard_plan import ShardJob, allot, open_source
from pecgrasp_env.capture.workers import Result, check_words, clouds, make_shards, prepare
from pecgrasp_env.common.job_share import JobShare

__all__ = ["Generation", "generate"]


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
    check_words(workers, on_error)
    if frames_at_once is not None and frames_at_once < 1:
        raise CaptureError(f"frames_at_once must be at least 1, or null for what the machine has, got {frames_at_once}")
    directory = Path(directory)
    started = time.monotonic()
    source = open_source(config)
    empty, jobs = allot(config, source)

    def make(missing: list[ShardJob]) -> Generator[Result, None, None]:
        prepare(source, missing, workers, on_error, preparing)
        return make_shards(clouds(config, frames_at_once), source, directory, missing, workers, on_error)

    manifest, n_new = make_missing(
        directory, empty, jobs, make, share=share, keep_skipped=on_error == "skip", finish=_split, progress=progress
    )
    rejected = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    skipped = {name: why for record in manifest.shards for name, why in record.skipped.items()}
    mended = {f"{i['class']}/{i['name']}": "; ".join(i["mended"]) for i in manifest.instances if "mended" in i}
    n_samples = sum(record.n_samples for record in manifest.shards)
    seconds = time.monotonic() - started
    return Generation(directory, n_samples, n_new, dict(rejected.most_common()), skipped, mended, seconds, manifest)


def _split(directory: Path, manifest: Manifest) -> None:
    shards = [read_shard(directory / record.file, mapped=False) for record in manifest.shards]
    labels = np.concatenate([shard.class_index for shard in shards]).astype(np.int64)
    belong = np.concatenate([shard.instance_index for shard in shards]).astype(np.int64)
    official = None
    if all("split" in instance for instance in manifest.instances):
        official = np.array([instance["split"] == "test" for instance in manifest.instances])[belong]
    dataset = CloudDataset(manifest.classes, [], labels, belong, "", originals=manifest.originals[belong])
    write_splits(directory, dataset, manifest.seed, official)
