"""Stand-ins for the tests of this folder: real sockets, on an address that each test process has alone."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from itertools import count

import pytest

from pecgrasp_env.real import ConnectionLost
from pecgrasp_env.real.fakes.bench import Bench

_STARTING_S = 180  # on a busy machine; the simulation builds its scene first
_numbers = count(1)


@pytest.fixture(scope="session")
def hosts():
    """A function that gives addresses, 127.x.y.z, which nothing else uses: all ports are fixed."""
    high, low = divmod(os.getpid() % 62_500, 250)
    return lambda: f"127.{70 + next(_numbers)}.{1 + high}.{1 + low}"


@pytest.fixture
def host(hosts):
    return hosts()


@contextmanager
def _fake_robot(host, *settings):
    command = [sys.executable, "-m", "pecgrasp", "fake-robot", f"host={host}", *settings]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    bench = None
    try:
        deadline = time.monotonic() + _STARTING_S
        while bench is None:
            try:
                bench = Bench(host)
            except ConnectionLost:
                assert process.poll() is None, "the stand-in did not start"
                assert time.monotonic() < deadline
                time.sleep(0.05)
        yield bench
        bench.ask(ask="stop")
        assert process.wait(_STARTING_S) == 0
    finally:
        if bench is not None:
            bench.close()
        process.kill()
        process.wait()


@pytest.fixture(scope="session")
def fake_robot():
    """`pecgrasp fake-robot` with settings, in a process of its own: a context, of its `Bench`."""
    return _fake_robot
