"""What renders on this machine, and what to do where nothing does: `pecgrasp doctor [--quiet]`."""

import sys

from pecgrasp_env.common import doctor


def main() -> None:
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        return
    sys.exit(doctor.main(sys.argv[1:]))
