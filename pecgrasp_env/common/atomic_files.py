"""Files that are there whole or not at all, whatever is killed while they are written."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Put `content` (text as UTF-8) in place of what `path` held; its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")  # several jobs may write one file
    temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    os.replace(temporary, path)
