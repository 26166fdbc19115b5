"""Words of a batch, one a sub-environment, which wrappers may index as they do tensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch


class Words(np.ndarray):
    """(N,) str objects. An index may be a tensor, on any device: NumPy takes one of a single value for an integer."""

    @classmethod
    def of(cls, texts: Sequence[str]) -> Words:
        return np.array(list(texts), dtype=object).view(cls)  # not of a fixed width, which would cut longer ones

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(_index(key))

    def __setitem__(self, key: Any, value: Any) -> None:
        super().__setitem__(_index(key), value)


def _index(key: Any) -> Any:
    return key.cpu().numpy() if isinstance(key, torch.Tensor) else key
