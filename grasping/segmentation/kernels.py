"""The compiled pixel loops of the segmenter, or None where they could not be built: NumPy then does the same."""

from __future__ import annotations

from types import ModuleType

compiled: ModuleType | None = None
try:
    from grasping.segmentation import _kernels as built  # type: ignore[attr-defined]
except ImportError:
    pass
else:
    compiled = built
