"""What NumPy raises where an .npz is gone, cut short, overwritten in places, or holds other arrays than expected."""

import zipfile
import zlib

__all__ = ["DAMAGED_NPZ"]

DAMAGED_NPZ = (
    OSError,
    ValueError,
    KeyError,
    IndexError,
    EOFError,
    TypeError,  # an array's header is evaluated as a Python literal
    SyntaxError,
    AttributeError,  # an .npy by another name
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)
