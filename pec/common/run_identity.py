"""Whether a run is the same as another: settings compared by name, and settings and files hashed to keys."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pec.errors import ConfigError

__all__ = ["check_same_run", "files_key", "first_difference", "flat_settings", "settings_key"]


def flat_settings(settings: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """{"a": {"b": 1}} as {"a.b": 1}, as Hydra's overrides name settings."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= flat_settings(value, f"{where}{name}.") if isinstance(value, Mapping) else {where + name: value}
    return flat


def first_difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """What a user is told of two records that are not of one run: "a.b=1, not 2"; None where they are equal.

    Both are plain values, mappings nested, one of them perhaps read from JSON: tuples and lists are alike, and so are
    None and a setting that an older version did not have.
    """
    flat_before, flat_now = (flat_settings(json.loads(json.dumps(record))) for record in (before, now))
    for name in flat_before | flat_now:
        if flat_before.get(name) != flat_now.get(name):
            return f"{name}={flat_before.get(name)!r}, not {flat_now.get(name)!r}"
    return None


def check_same_run(
    output: str, config: Mapping[str, Any], data: str, earlier: Mapping[str, Any], other_data: str
) -> None:
    """ConfigError where the run that is in ``output`` already, with its "config" and "data", had other settings than
    ``config``, or other ``data``, which the message then calls ``other_data``.
    """
    difference = first_difference(earlier["config"], config)
    if difference is None and earlier["data"] != data:
        difference = other_data
    if difference is not None:
        raise ConfigError(f"output {output} holds a run with {difference}: choose another output, or delete it")


def settings_key(*decisive: Any) -> str:
    """16 hexadecimal digits that differ where the `decisive` plain values do; the order of names does not count."""
    return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()[:16]


def files_key(files: Iterable[Path]) -> str:
    """16 hexadecimal digits that differ where the contents of `files` do, wherever they lie."""
    digests = (hashlib.sha256(file.read_bytes()).digest() for file in files)
    return hashlib.sha256(b"".join(digests)).hexdigest()[:16]
