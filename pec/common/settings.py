"""Settings from a Hydra config or any mapping, checked: an unknown or senseless one is an error that names it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

from pec.errors import ConfigError

__all__ = ["one_of", "positive", "settings_as"]

T = TypeVar("T")


def settings_as(cls: type[T], settings: Mapping[str, Any]) -> T:
    """The dataclass `cls` of nested `settings`. Raises ConfigError that names an unknown, missing or wrong one."""
    return _build(cls, settings, "")


def one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    """Raises ConfigError where the setting `name` has a value that is not allowed."""
    if value not in allowed:
        raise ConfigError(f"{name} must be one of {', '.join(allowed)}, got {value!r}")


def positive(**values: float) -> None:
    """Raises ConfigError where a setting is not; `protocol__epochs=` names protocol.epochs."""
    for name, value in values.items():
        if value <= 0:
            raise ConfigError(f"{name.replace('__', '.')} must be positive, got {value}")


def _build(cls: type[T], settings: Mapping[str, Any], where: str) -> T:
    hints = get_type_hints(cls)
    known = {item.name for item in fields(cls)}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for name, value in settings.items():
        if name not in known:
            raise ConfigError(f"unknown setting {where}{name}; known: {', '.join(sorted(known))}")
        hint = hints[name]
        if is_dataclass(hint):
            if not isinstance(value, Mapping):
                raise ConfigError(f"{where}{name} must be a group of settings, got {value!r}")
            value = _build(hint, value, f"{where}{name}.")  # type: ignore[arg-type]
        else:
            value = _plain(hint, value, where + name)
        values[name] = value
    try:
        return cls(**values)
    except TypeError as error:
        raise ConfigError(f"a setting is missing in {where or 'the configuration'}: {error}") from error


def _plain(hint: Any, value: Any, name: str) -> Any:
    """`value` as the type `hint`: only whole numbers to float and sequences to list are converted."""
    if value is None:
        if type(None) in getattr(hint, "__args__", ()):
            return None
        raise ConfigError(f"{name} must be set")
    if hint in (list[str], list[str] | None):
        if isinstance(value, str) or not all(isinstance(item, str) for item in value):
            raise ConfigError(f"{name} must be a list of names, got {value!r}")
        return list(value)
    wanted = next(item for item in getattr(hint, "__args__", (hint,)) if item is not type(None))
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, wanted) or (wanted is int and isinstance(value, bool)):
        raise ConfigError(f"{name} must be {wanted.__name__}, got {value!r}")
    return value
