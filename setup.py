"""What pyproject.toml cannot say: how to compile the kernels, that they may be left out, and where conf/ lies."""

from glob import glob

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext


class BuildKernels(build_ext):
    """Compile so that a result is the NumPy reference's to the last bit: no fused multiply-add, no reordering."""

    def build_extensions(self) -> None:
        if self.compiler.compiler_type != "msvc":  # whose /fp:precise is the default
            for extension in self.extensions:
                extension.libraries.append("m")  # the same sin, cos, … as Python's `math`
                extension.extra_compile_args += ["-std=c99", "-O3", "-ffp-contract=off", "-Wall", "-Wextra"]
        super().build_extensions()


FOLDERS = ("grasping/curvature_planner", "pec/preprocessing")

setup(
    packages=[*find_packages(include=["grasping*", "pec*"]), "pecgrasp.conf"],
    package_dir={"pecgrasp.conf": "conf"},
    cmdclass={"build_ext": BuildKernels},
    ext_modules=[
        Extension(
            f"{folder.replace('/', '.')}._kernels",
            sorted(glob(f"{folder}/csrc/*.c")),
            include_dirs=["csrc"],
            depends=glob(f"{folder}/csrc/*.h") + glob("csrc/*.h"),
            optional=True,  # without a compiler the package still installs, and does the same without them
        )
        for folder in FOLDERS
    ],
)
