#!/usr/bin/env bash
# Make .venv and whatever the simulator needs to draw; done before, it ends in seconds. `make demo` and `make test` call it.
# Choices: PYTHON=python3.12 (any 3.10-3.12), TORCH=torch==2.13.0 (any build or version that pyproject.toml admits).
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf 'setup: %s\n' "$*"; }
die() { printf 'setup: %s\n' "$*" >&2; exit 1; }

is_root() { [ "$(id -u)" = 0 ]; }
has_apt() { command -v apt-get >/dev/null; }

# Runs apt-get, or ends with the one message that names what is missing and why it is not installed here.
apt_install() {
    local reason=$1; shift
    has_apt || die "$reason. This is no Debian or Ubuntu: install what these packages bring, then start again: $*"
    is_root || die "$reason. Without root nothing is installed: run 'apt-get install $*' as root, then start again."
    say "$reason: installing $*"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@" >/dev/null
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.12 python3.11 python3.10}; do
        if "$candidate" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

make_venv() {
    local python
    if ! python=$(find_python); then
        [ -z "${PYTHON:-}" ] || die "PYTHON=$PYTHON is not a Python 3.10, 3.11 or 3.12 (ManiSkill has none newer)"
        apt_install "no Python 3.10-3.12 was found" python3 python3-venv
        python=$(find_python) || die "this system's Python is not 3.10-3.12: install one of them and pass PYTHON=python3.12"
    fi
    # Debian's python3 comes without ensurepip until python3-venv is there.
    "$python" -c 'import ensurepip, venv' 2>/dev/null || apt_install "Python's venv module is missing" python3-venv
    say "virtual environment .venv with $("$python" --version)"
    "$python" -m venv --clear .venv
}

has_headers() {
    .venv/bin/python -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_paths()["include"] + "/Python.h"))'
}

# The kernels are compiled where they can be; where not, NumPy and torch do the same without them.
find_compiler() {
    local missing=()
    command -v gcc >/dev/null || missing+=(gcc libc6-dev)
    has_headers || missing+=("$(.venv/bin/python -c 'import sys; print("python%d.%d-dev" % sys.version_info[:2])')")
    if [ ${#missing[@]} = 0 ]; then return; fi
    if is_root && has_apt; then
        (apt_install "the kernels cannot be compiled yet" "${missing[@]}") || say "that failed"
    else
        say "the kernels cannot be compiled without ${missing[*]}"
    fi
}

# Built from other sources, kernels may not be those that their callers take them for.
forget_kernels() { rm -f {grasping/curvature_planner,grasping/segmentation,pec/preprocessing}/_kernels.*.so; }

say_without_kernels() {
    .venv/bin/python -c 'import sys, grasping, pec; sys.exit(not (grasping.compiled and pec.compiled))' ||
        say "planner, segmenter or classifier do without their compiled kernels: they could not be built"
}

install_packages() {
    # Torch first and by itself: left to the resolver, a machine without a GPU may get another build of several GB.
    say "packages (a few minutes)"
    .venv/bin/python -c 'import torch' 2>/dev/null || .venv/bin/python -m pip install -q --disable-pip-version-check "${TORCH:-torch==2.13.0}"
    .venv/bin/python -m pip install -q --disable-pip-version-check -e '.[sim,dev]'
}

# Debian 12's own Mesa (22.3) lacks a Vulkan feature that SAPIEN needs; the backports have it. The mirror is the one in use.
add_backports() {
    local mirror
    apt-get update -qq
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Codename: bookworm' | head -n 1)
    [ -n "$mirror" ] || die "no Debian mirror is configured: add bookworm-backports by hand, then start again"
    printf 'Types: deb\nURIs: %s\nSuites: bookworm-backports\nComponents: main\nSigned-By: /usr/share/keyrings/debian-archive-keyring.gpg\n' \
        "$mirror" >/etc/apt/sources.list.d/pecgrasp-backports.sources
}

install_driver() {
    local release=()
    if has_apt && grep -q 'VERSION_CODENAME=bookworm' /etc/os-release; then
        release=(-t bookworm-backports)
        ! is_root || add_backports
    fi
    apt_install "SAPIEN finds no Vulkan device" "${release[@]}" libvulkan1 mesa-vulkan-drivers
    .venv/bin/python -m pecgrasp_env.common.doctor || die "the driver is installed, but nothing renders: see the report above"
}

# ManiSkill imports OpenCV, whose wheel leaves two libraries of a desktop to the system.
install_opencv_libraries() {
    apt_install "OpenCV misses system libraries" libgl1 libglib2.0-0
    .venv/bin/python -c 'import cv2' || die "OpenCV still does not load: see the message above"
}

# The camera's library leaves USB to the system; without it, what needs a camera says so, and its tests are left out.
install_usb_library() {
    if is_root && has_apt; then
        (apt_install "the camera's library misses a system library" libusb-1.0-0) || say "that failed"
    else
        say "pyrealsense2 does not load without libusb-1.0-0"
    fi
}

# What the environment and the kernels in it were made from; a change makes them anew.
kernels() { echo "$(cat setup.py csrc/* {grasping/curvature_planner,grasping/segmentation,pec/preprocessing}/csrc/* | sha256sum | cut -c1-16) $(command -v gcc)"; }
wanted="$(sha256sum pyproject.toml | cut -c1-16) ${TORCH:-torch==2.13.0} $PWD"
if [ "$(cat .venv/.pecgrasp 2>/dev/null)" != "$wanted" ]; then
    [ -x .venv/bin/python ] && .venv/bin/python -m pip --version >/dev/null 2>&1 || make_venv
    find_compiler
    forget_kernels
    install_packages
    printf '%s' "$wanted" >.venv/.pecgrasp
    kernels >.venv/.pecgrasp_kernels
    say_without_kernels
elif [ "$(cat .venv/.pecgrasp_kernels 2>/dev/null)" != "$(kernels)" ]; then
    say "the kernels, whose sources or compiler changed"
    find_compiler
    forget_kernels
    # Without a network pip fails: the next run tries again.
    ! .venv/bin/python -m pip install -q --disable-pip-version-check --no-deps -e . || kernels >.venv/.pecgrasp_kernels
    say_without_kernels
fi
.venv/bin/python -c 'import cv2' 2>/dev/null || install_opencv_libraries
.venv/bin/python -c 'import pyrealsense2' 2>/dev/null || install_usb_library
.venv/bin/python -m pecgrasp_env.common.doctor --quiet || install_driver
