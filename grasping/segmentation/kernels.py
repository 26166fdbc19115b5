"""The compiled pixel loops of the segmenter, or None where they could not be built: NumPy then does the same.

None, too, after a change of the sources that was not built yet. Whoever sets `compiled` to None has the references do
all the work, to the last bit as the kernels do it.
"""

from __future__ import annotations

from types import ModuleType

INTERFACE = 6  # as in csrc/module.c


def _load() -> ModuleType | None:
    try:
        from grasping.segmentation import _kernels
    except ImportError:
        return None
    return _kernels if getattr(_kernels, "INTERFACE", None) == INTERFACE else None


compiled = _load()
