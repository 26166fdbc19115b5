"""Which shards a data set has, a fixed list that the configuration alone decides, and which of them a job makes."""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pec.shards import MANIFEST_NAME, Manifest
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.workers import Member, ShardJob, instance_entry, open_source

__all__ = ["Part", "plan"]

_PACKAGES = ("pecgrasp", "sapien", "numpy", "scipy", "trimesh", "coacd")
"""What decides the bytes of a sample."""


@dataclass(frozen=True)
class Part:
    """Job `index` of `count`, 0 ≤ index < count."""

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Of "0/8". Raises CaptureError where it is not of that form."""
        match = re.fullmatch(r"(\d+)/(\d+)", text)
        part = cls(*map(int, match.groups())) if match else cls(0, 0)
        if part.index >= part.count:
            raise CaptureError(f"shard={text!r}: must be i/n with 0 ≤ i < n, such as 0/8 for the first of eight jobs")
        return part

    @property
    def manifest_name(self) -> str:
        return MANIFEST_NAME.replace(".json", f".{self.index}of{self.count}.json")

    def of(self, jobs: Sequence[ShardJob]) -> Sequence[ShardJob]:
        """This part of the jobs: neighbours, so that few objects are loaded in more than one part."""
        return jobs[len(jobs) * self.index // self.count : len(jobs) * (self.index + 1) // self.count]


def plan(config: CaptureConfig) -> tuple[Manifest, list[ShardJob]]:
    """The empty manifest of the data set, and all its shards."""
    source = open_source(config)
    instances: list[dict[str, Any]] = []
    members: list[Member] = []
    for class_index, class_name in enumerate(source.classes):
        for number in range(len(source.names(class_name)[: config.objects.instances_per_class])):
            members.append(Member(class_index, len(instances), number))
            instances.append(instance_entry(source, class_name, number))
    jobs: list[ShardJob] = []
    for group in _groups(config, members):
        step = max(1, config.shard_size // len(group))
        for first in range(0, config.samples_per_instance, step):
            jobs.append(ShardJob(len(jobs), group, first, min(step, config.samples_per_instance - first)))
    versions = {package: importlib.metadata.version(package) for package in _PACKAGES}
    manifest = Manifest(list(source.classes), instances, config.cameras, config.described(), config.seed, versions)
    return manifest, jobs


def _groups(config: CaptureConfig, members: list[Member]) -> list[tuple[Member, ...]]:
    """Those that are captured together: in `tabletop` those that share a table, else as many as fill a shard."""
    if config.scenario != "tabletop":
        size = max(1, config.shard_size // config.samples_per_instance)
        return [tuple(members[start : start + size]) for start in range(0, len(members), size)]
    size = config.tabletop.objects_per_frame
    # At random, else those that share a table would be of one class.
    order = np.random.default_rng([config.seed, 0x7AB1E]).permutation(len(members))
    return [tuple(members[i] for i in order[start : start + size]) for start in range(0, len(order), size)]
