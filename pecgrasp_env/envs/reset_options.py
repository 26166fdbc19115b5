"""`reset(options=…)`: the class that is asked for, the objects on the table, and ManiSkill's own options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.scene.actors import Wish

_MANISKILL = ("reconfigure", "env_idx", "reset_to_env_states")
OPTIONS = ("target", "objects", *_MANISKILL)


def read_options(
    options: Mapping[str, Any] | None,
    source: Any,
    classes: Sequence[str],
    n_objects: int,
    twins: bool,
    num_envs: int,
) -> tuple[dict[str, Any], list[Wish]]:
    """ManiSkill's options for this reset, and what each sub-environment (num_envs,) is asked for.

    Args:
        options: of `reset`. ``target``: a class, or one (or None) for each sub-environment that is reset. ``objects``:
            n_objects names, of a class, of an instance or class/instance, or such a list for each sub-environment.
        source: of the objects. classes: those that may be asked for. n_objects: on each table. twins: the asked-for
            class is to be there twice. num_envs: sub-environments.

    Raises:
        TaskError: an option is unknown, or it names what there is not.
    """
    given = dict(options or {})
    for name in given:
        if name not in OPTIONS:
            raise TaskError(f"options={{{name!r}: …}}: no such option, there are {', '.join(OPTIONS)}")
    theirs = {name: given[name] for name in _MANISKILL if name in given}
    wanted, names = given.get("target"), given.get("objects")
    if (wanted is not None or names is not None) and "reset_to_env_states" in theirs:
        raise TaskError("options: with reset_to_env_states the state says what lies there and what is asked for")
    rows = list(range(num_envs)) if "env_idx" not in theirs else [int(i) for i in theirs["env_idx"]]
    targets: list[int | None] = [None] * num_envs
    for i, name in zip(rows, _one_each("target", wanted, len(rows)), strict=True):
        targets[i] = None if name is None else _class_index(name, classes)
    tables: list[tuple[tuple[str, int | None], ...] | None] = [None] * num_envs
    if names is not None:
        if len(rows) < num_envs:
            raise TaskError("options: objects are built anew for all sub-environments, so env_idx must name all")
        theirs["reconfigure"] = True
        for i, each in zip(rows, _lists(names, len(rows)), strict=True):
            tables[i] = _objects(each, source, classes, n_objects)
    wishes = [Wish(target, table) for target, table in zip(targets, tables, strict=True)]
    for wish in wishes:
        _check(wish, classes, twins)
    return theirs, wishes


def _one_each(name: str, value: Any, n: int) -> list[Any]:
    if value is None or isinstance(value, str):
        return [value] * n
    if not isinstance(value, Sequence) or len(value) != n:
        raise TaskError(f"options={{{name!r}: {value!r}}}: must be a name, or one for each of {n} sub-environments")
    return list(value)


def _lists(names: Any, n: int) -> list[Any]:
    if isinstance(names, str) or not isinstance(names, Sequence) or not names:
        raise TaskError(f"options={{'objects': {names!r}}}: must be a list of names of classes or instances")
    if all(isinstance(name, str) for name in names):
        return [names] * n
    return _one_each("objects", names, n)


def _class_index(name: Any, classes: Sequence[str]) -> int:
    if name not in classes:
        raise TaskError(f"options={{'target': {name!r}}}: must be one of the classes {', '.join(classes)}")
    return list(classes).index(name)


def _objects(
    names: Sequence[Any], source: Any, classes: Sequence[str], n_objects: int
) -> tuple[tuple[str, int | None], ...]:
    if len(names) != n_objects:
        raise TaskError(
            f"options={{'objects': {list(names)!r}}}: are {len(names)}, the task has n_objects={n_objects}: name as "
            f"many, or make the environment with n_objects={len(names)}"
        )
    return tuple(_object(name, source, classes) for name in names)


def _object(name: Any, source: Any, classes: Sequence[str]) -> tuple[str, int | None]:
    """Class and number of an instance, None for any of the class."""
    if name in classes:
        return str(name), None
    asked_class, slash, asked_instance = str(name).rpartition("/")
    found = [
        (each, i)
        for each in ([asked_class] if slash and asked_class in classes else classes)
        for i, instance in enumerate(source.names(each))
        if instance == (asked_instance if slash else name)
    ]
    if len(found) > 1:
        ways = ", ".join(f"{each}/{name}" for each, _ in found)
        raise TaskError(f"options={{'objects': [… {name!r} …]}}: more than one class has it, say {ways}")
    if not found:
        example = f"{classes[0]}/{source.names(classes[0])[0]}"
        raise TaskError(
            f"options={{'objects': [… {name!r} …]}}: is neither a class ({', '.join(classes)}) nor an instance of one, "
            f"such as {example}"
        )
    return found[0]


def _check(wish: Wish, classes: Sequence[str], twins: bool) -> None:
    if wish.objects is None:
        return
    there = [name for name, _ in wish.objects]
    if wish.target is not None and classes[wish.target] not in there:
        raise TaskError(
            f"options={{'target': {classes[wish.target]!r}}}: is none of the objects, which are of {', '.join(there)}"
        )
    asked = there if wish.target is None else [classes[wish.target]]
    if twins and not any(there.count(name) == 2 for name in asked):
        raise TaskError(f"options={{'objects': …}}: same_class_twins wants the asked-for class there twice, of {there}")
