"""`reset(options=…)`: the class that is asked for, the objects on the table, and ManiSkill's own options."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.scene.actors import Recipe, Wish

_MANISKILL = ("reconfigure", "env_idx", "reset_to_env_states")
OPTIONS = ("target", "objects", "strangers", "absent", *_MANISKILL)


def read_options(options: Mapping[str, Any] | None, recipe: Recipe, num_envs: int) -> tuple[dict[str, Any], list[Wish]]:
    """ManiSkill's options for this reset, and what each sub-environment (num_envs,) is asked for.

    Args:
        options: of `reset`. ``target``: a class, or one (or None) for each sub-environment that is reset. ``objects``:
            n_objects names, of a class, of an instance or class/instance, or such a list for each sub-environment.
            ``strangers``: n_strangers names, or such lists. ``absent``: whether the asked-for class is away, or that
            (or None) for each.
        recipe: of what may lie on each table. num_envs: sub-environments.

    Raises:
        TaskError: an option is unknown, or it names what there is not.
    """
    given = dict(options or {})
    for name in given:
        if name not in OPTIONS:
            raise TaskError(f"options={{{name!r}: …}}: no such option, there are {', '.join(OPTIONS)}")
    theirs = {name: given[name] for name in _MANISKILL if name in given}
    named = {name: given[name] for name in ("target", "objects", "strangers", "absent") if given.get(name) is not None}
    if named and "reset_to_env_states" in theirs:
        raise TaskError("options: with reset_to_env_states the state says what lies there and what is asked for")
    rows = list(range(num_envs)) if "env_idx" not in theirs else [int(i) for i in theirs["env_idx"]]
    if ("objects" in named or "strangers" in named) and len(rows) < num_envs:
        raise TaskError("options: objects are built anew for all sub-environments, so env_idx must name all")
    if "objects" in named or "strangers" in named:
        theirs["reconfigure"] = True
    wishes = [Wish() for _ in range(num_envs)]
    targets = _one_each("target", named.get("target"), len(rows), str)
    absences = _one_each("absent", named.get("absent"), len(rows), bool)
    tables, strangers = (_lists(name, named.get(name), len(rows)) for name in ("objects", "strangers"))
    for i, target, absent, table, strange in zip(rows, targets, absences, tables, strangers, strict=True):
        wishes[i] = Wish(
            None if target is None else _class_index(target, recipe.classes),
            None if table is None else _objects(table, recipe.source, recipe.classes, recipe.n_objects),
            None if strange is None else _strangers(strange, recipe),
            None if absent is None else _absent(absent, recipe),
        )
        _check(wishes[i], recipe)
    return theirs, wishes


def _one_each(name: str, value: Any, n: int, kind: type) -> list[Any]:
    if value is None or isinstance(value, kind):
        return [value] * n
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != n:
        what = "a name" if kind is str else "True or False"
        raise TaskError(f"options={{{name!r}: {value!r}}}: must be {what}, or one for each of {n} sub-environments")
    return list(value)


def _lists(name: str, names: Any, n: int) -> list[Any]:
    if names is None:
        return [None] * n
    if isinstance(names, str) or not isinstance(names, Sequence) or not names:
        what = "classes or instances" if name == "objects" else "strangers"
        raise TaskError(f"options={{{name!r}: {names!r}}}: must be a list of names of {what}")
    if all(isinstance(each, str) for each in names):
        return [names] * n
    if len(names) != n:
        raise TaskError(f"options={{{name!r}: {names!r}}}: must be names, or such a list for each of {n}")
    return list(names)


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


def _strangers(names: Sequence[Any], recipe: Recipe) -> tuple[int, ...]:
    if len(names) != recipe.n_strangers or recipe.strangers is None:
        raise TaskError(
            f"options={{'strangers': {list(names)!r}}}: are {len(names)}, the task has n_strangers={recipe.n_strangers}"
            f": name as many, or make the environment with n_strangers={len(names)}"
        )
    there = list(recipe.strangers.names)
    for name in names:
        if name not in there:
            near = difflib.get_close_matches(str(name), there, 3) or there[:3]
            raise TaskError(f"options={{'strangers': [… {name!r} …]}}: is none of them, such as {', '.join(near)}")
    return tuple(there.index(name) for name in names)


def _absent(absent: Any, recipe: Recipe) -> bool:
    if not isinstance(absent, bool):
        raise TaskError(f"options={{'absent': {absent!r}}}: must be True or False")
    if absent and recipe.absent is None:
        raise TaskError(
            "options={'absent': True}: there is no action to say so; make the environment with absent=True, or with "
            "the probability of it, such as absent=0.0"
        )
    return absent


def _check(wish: Wish, recipe: Recipe) -> None:
    if wish.objects is None:
        return
    classes, there = recipe.classes, [name for name, _ in wish.objects]
    target = None if wish.target is None else classes[wish.target]
    may_be_away = recipe.absent is not None and wish.absent is not False
    if wish.absent and (target in there if target is not None else set(there) >= set(classes)):
        raise TaskError(
            f"options={{'absent': True}}: of {target or 'every class'} there is one among the objects named"
        )
    if target is not None and target not in there and not may_be_away:
        raise TaskError(f"options={{'target': {target!r}}}: is none of the objects, which are of {', '.join(there)}")
    asked = there if target is None else [target]
    if recipe.twins and not may_be_away and not any(there.count(name) == 2 for name in asked):
        raise TaskError(f"options={{'objects': …}}: same_class_twins wants the asked-for class there twice, of {there}")
