"""Stand-ins for the tests of this folder: real sockets, on an address that each test process has alone."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest

from pec.training.loop import train
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


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory):
    """A classifier of large balls and thin rods, which takes seconds to train."""
    folder = tmp_path_factory.mktemp("classifier")
    rng = np.random.default_rng(0)
    clouds, labels, things = [], [], []
    for label, axes in enumerate([(0.15, 0.15, 0.15), (0.25, 0.006, 0.006)]):
        for thing in range(8):
            size = np.array(axes) * rng.uniform(0.8, 1.2)
            for _ in range(6):
                points = rng.normal(size=(200, 3))
                points *= size / np.linalg.norm(points, axis=1, keepdims=True)
                points = points[points[:, 2] < 0.3 * size[2]]  # seen from one side
                turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
                clouds.append((points[:120] @ turn.T + np.array([0, 0, 0.6])).astype(np.float32))
                labels.append(label)
                things.append(8 * label + thing)
    offsets = np.cumsum([0, *map(len, clouds)])
    named = {"labels": np.array(labels), "instances": np.array(things), "class_names": np.array(["ball", "rod"])}
    np.savez(folder / "clouds.npz", points=np.concatenate(clouds), offsets=offsets, **named)
    settings = {"dataset": {"path": str(folder / "clouds.npz")}, "output": str(folder / "run")}
    settings |= {"protocol": {"epochs": 4, "batch_size": 16}, "progress": False, "cache": str(folder / "cache")}
    return train(settings)["checkpoint"]


TARGET = "plug_adapter"


@pytest.fixture(scope="session")
def scene_bench(hosts):
    """A stand-in over the simulated scene with one object on the table, so that none needs to be told from others."""
    host = hosts()
    scene = ["env.n_objects=1", f"env.classes=[{TARGET}]", "env.objects.instances_per_class=2"]
    with _fake_robot(host, *scene, "seed=1", "pace=4") as bench:
        bench.host = host
        yield bench
