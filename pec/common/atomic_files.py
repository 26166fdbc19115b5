"""Files and directories that are there whole or not at all, whatever is killed while they are written."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

__all__ = ["current_directory", "replacing", "replacing_directory", "write_json", "write_whole"]


def write_whole(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Put `content` (text as UTF-8) in place of what `path` held; its folder is made where it is missing.

    Raises OSError that names `path`.
    """
    try:
        with replacing(path) as temporary:
            temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        error.filename, error.filename2 = str(path), None  # a full disk's error names no file, or the temporary one
        raise


def write_json(path: str | os.PathLike[str], content: Any, indent: int | None = 1) -> None:
    """Write `content` as JSON and a line end. Raises as `write_whole`."""
    write_whole(path, json.dumps(content, indent=indent) + "\n")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path of the same name for another writer to write to; what it wrote, if anything, takes the place of `path`.

    It lies in a temporary directory beside `path` (STEM.….tmp), so several processes may write one file. Where the
    block raises, `path` stays as it was. A directory can be put where there is none yet, otherwise OSError is raised.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f"{path.stem}.", suffix=".tmp", dir=path.parent) as folder:
        temporary = Path(folder) / path.name
        yield temporary
        if temporary.is_file():
            with temporary.open("rb") as file:
                os.fsync(file.fileno())  # a rename that outlives a power cut must not point to an empty file
        if temporary.exists():
            os.replace(temporary, path)


@contextmanager
def replacing_directory(directory: str | os.PathLike[str]) -> Iterator[Path]:
    """An empty directory that takes the place of `directory` and of all that this held; for a single writer.

    A directory cannot be replaced in one step. So readers ask `current_directory` where it lies.
    """
    directory = Path(directory)
    new, old = directory.with_name(directory.name + ".new.tmp"), _replaced(directory)
    if current_directory(directory) == old:
        os.rename(old, directory)
    shutil.rmtree(old, ignore_errors=True)
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    yield new
    if directory.exists():
        os.rename(directory, old)
    os.rename(new, directory)
    shutil.rmtree(old, ignore_errors=True)


def current_directory(directory: str | os.PathLike[str]) -> Path:
    """Where a directory is to be read: the one that is replaced while, or since, that stopped between two renames."""
    directory = Path(directory)
    old = _replaced(directory)
    return old if old.exists() and not directory.exists() else directory


def _replaced(directory: Path) -> Path:
    return directory.with_name(directory.name + ".old.tmp")
