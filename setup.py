"""What pyproject.toml cannot say: how to compile the kernels, that they may be left out, and where conf/ lies."""

import sys
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext


class BuildKernels(build_ext):
    """Compile so that a result is the NumPy reference's to the last bit: no fused multiply-add, no reordering."""

    def build_extensions(self) -> None:
        if self.compiler.compiler_type != "msvc":  # whose /fp:precise is the default
            for extension in self.extensions:
                extension.libraries.append("m")  # the same sin, cos, … as Python's `math`
                # Nobody asks for errno or traps: square roots and choices are made for several numbers at once.
                exact = ["-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"]
                extension.extra_compile_args += ["-std=c99", "-O3", *exact, "-Wall", "-Wextra"]
        super().build_extensions()

    def copy_extensions_to_source(self) -> None:
        super().copy_extensions_to_source()
        for extension in self.extensions:  # Python would find one that an older set-up built, before this one
            built = Path(self.get_ext_fullpath(extension.name))
            for other in built.parent.glob("_kernels.*"):
                if built.exists() and other.suffix in (".so", ".pyd") and other != built:
                    other.unlink()


FOLDERS = ("grasping/curvature_planner", "grasping/pose", "grasping/segmentation", "pec/preprocessing")

# One wheel for every Python: the stable ABI. Buffers entered its headers with 3.11, but 3.10 exports the same functions
# and lays Py_buffer out alike, so what 3.11 or newer builds runs on 3.10, too; 3.10 itself builds for itself alone.
STABLE = sys.version_info >= (3, 11)

setup(
    packages=[*find_packages(include=["grasping*", "pec*"]), "pecgrasp.conf"],
    package_dir={"pecgrasp.conf": "conf"},
    options={"bdist_wheel": {"py_limited_api": "cp310"}} if STABLE else {},
    cmdclass={"build_ext": BuildKernels},
    ext_modules=[
        Extension(
            f"{folder.replace('/', '.')}._kernels",
            sorted(glob(f"{folder}/csrc/*.c")),
            include_dirs=["csrc"],
            depends=glob(f"{folder}/csrc/*.h") + glob("csrc/*.h"),
            define_macros=[("Py_LIMITED_API", "0x030B0000")] if STABLE else [],
            py_limited_api=STABLE,
            optional=True,  # without a compiler the package still installs, and does the same without them
        )
        for folder in FOLDERS
    ],
)
