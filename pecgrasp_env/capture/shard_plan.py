"""How a data set is allotted to shards: a fixed list that the configuration and the names of its objects decide."""

from __future__ import annotations

import importlib.metadata
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pec.data.shards import Manifest
from pecgrasp_env.capture.config import CaptureConfig, ObjectsConfig
from pecgrasp_env.capture.source import Source
from pecgrasp_env.capture.with_strangers import WithStrangers, n_drawn
from pecgrasp_env.objects import LARS_CLASSES, UNKNOWN, Catalogue
from pecgrasp_env.objects.deform import Deformed
from pecgrasp_env.objects.mesh_folder import MeshFolder
from pecgrasp_env.objects.modelnet import ModelNetArchive
from pecgrasp_env.objects.ycb import YcbDownload, YcbLookAlikes, find_models

__all__ = ["Member", "ShardJob", "allot", "instance_entry", "known_source", "made_by", "open_source"]

_PACKAGES = ("pecgrasp", "sapien", "numpy", "scipy", "trimesh", "coacd")
"""What decides the bytes of a sample."""


def allot(config: CaptureConfig, source: Source) -> tuple[Manifest, list[ShardJob]]:
    """The empty manifest of the data set, and all its shards."""
    instances: list[dict[str, Any]] = []
    members: list[Member] = []
    strangers: list[Member] = []
    for class_index, class_name in enumerate(source.classes):
        names = source.names(class_name)
        n_own = source.n_own if isinstance(source, WithStrangers) and class_name == UNKNOWN else len(names)
        own = list(range(n_own))[: _most(config)]
        for number in (*own, *range(n_own, len(names))):
            member = Member(class_index, len(instances), number)
            (members if number < n_own else strangers).append(member)
            instances.append(instance_entry(source, class_name, number))
    jobs: list[ShardJob] = []
    together = [([*members, *strangers], config.samples_per_instance)]
    alone = [(members, config.samples_per_instance), (strangers, config.samples_of_stranger)]
    for among, n_samples in together if config.scenario == "piled" else alone:
        for group in _groups(config, among, n_samples):
            step = max(1, config.shard_size // len(group))
            for first in range(0, n_samples, step):
                jobs.append(ShardJob(len(jobs), group, first, min(step, n_samples - first)))
    described = replace(config, objects=replace(config.objects, strangers=len(strangers))).described()
    manifest = Manifest(list(source.classes), instances, config.cameras, described, config.seed, made_by())
    return manifest, jobs


def _most(config: CaptureConfig) -> int | None:
    """Instances of a class, deformed ones included; None: all."""
    objects = config.objects
    return None if objects.instances_per_class is None else objects.instances_per_class * (1 + objects.deformations)


def made_by() -> dict[str, str]:
    """The packages that decide the bytes of a data set, and their versions."""
    return {package: importlib.metadata.version(package) for package in _PACKAGES}


def _groups(config: CaptureConfig, members: list[Member], n_samples: int) -> list[tuple[Member, ...]]:
    """Those that are captured together, `n_samples` each: those that share a table, else as many as fill a shard."""
    if config.scenario not in ("tabletop", "piled"):
        size = max(1, config.shard_size // n_samples)
        return [tuple(members[start : start + size]) for start in range(0, len(members), size)]
    size = config.tabletop.objects_per_frame
    # At random, else those that share a table would be of one class.
    order = np.random.default_rng([config.seed, 0x7AB1E]).permutation(len(members))
    return [tuple(members[i] for i in order[start : start + size]) for start in range(0, len(order), size)]


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


def instance_entry(source: Source, class_name: str, number: int) -> dict[str, Any]:
    """What the manifest says of an instance before it is captured."""
    entry = {
        "name": source.names(class_name)[number],
        "class": class_name,
        "origin": source.origin(class_name, number),
    }
    if copy_of := _copied(source, class_name, number):
        entry["copy_of"] = copy_of
    if isinstance(source, ModelNetArchive):
        entry["split"] = source.split(class_name, number)
    return entry


def _copied(source: Source, class_name: str, number: int) -> str | None:
    """The name of what the instance is a deformed copy of, if it is one."""
    base = source.base if isinstance(source, WithStrangers) else source
    if not isinstance(base, Deformed) or class_name not in base.classes or number >= len(base.names(class_name)):
        return None
    original, copy = base.original(class_name, number)
    return base.base.names(class_name)[original] if copy else None


def open_source(config: CaptureConfig) -> Source:
    """The objects that `config` names, with strangers the last of their classes where there are any.

    Raises ObjectError for an unknown class, an empty or missing folder.
    """
    source = _open_known(config)
    n_strangers = n_drawn(config, source)
    if n_strangers == 0 and UNKNOWN not in source.classes:
        return source
    return WithStrangers(source, n_strangers, config.objects.seed)


def known_source(manifest: Manifest) -> Source:
    """The objects that a data set was made of, strangers left out. Raises KeyError, TypeError or ValueError where its
    configuration does not say them, and as `open_source` does."""
    settings = manifest.config["objects"]
    values = {name: value for name, value in settings.items() if not name.startswith("strangers")}
    if values.get("classes") is not None:
        values["classes"] = tuple(values["classes"])
    return open_source(CaptureConfig(objects=ObjectsConfig(**values, strangers=0)))


def _open_known(config: CaptureConfig) -> Source:
    source, objects = _open_undeformed(config), config.objects
    if objects.deformations == 0:
        return source
    return Deformed(source, objects.deformations, objects.deformation, objects.seed, untouched=(UNKNOWN,))


def _open_undeformed(config: CaptureConfig) -> Source:
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
    classes, count = objects.classes or LARS_CLASSES, objects.instances_per_class or 20
    return Catalogue(classes, count, objects.seed, objects.families)
