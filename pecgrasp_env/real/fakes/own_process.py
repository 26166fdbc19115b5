"""A stand-in in a process of its own, on an address that nothing else uses: for programs that need one for a while."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from itertools import count

from pecgrasp_env.real.errors import ConnectionLost
from pecgrasp_env.real.fakes.bench import Bench
from pecgrasp_env.real.fakes.fake_robot import FakeRobot
from pecgrasp_env.real.fakes.plant import Plant

_STARTING_S = 300.0  # a simulation builds its scene first
_ENDING_S = 5.0
_numbers = count(1)


class StandIn:
    """`host` is its address, `bench` its bench. It ends with `close`, and where the process that made it dies.

    Args:
        make_plant: makes what moves, over there; must be picklable.
        pace: simulated seconds a second, at most.

    Raises ConnectionLost where it does not start.
    """

    def __init__(self, make_plant: Callable[[], Plant], pace: float = 1.0) -> None:
        own = os.getpid()
        self.host = f"127.{100 + next(_numbers) % 100}.{1 + own // 250 % 250}.{1 + own % 250}"
        arguments = (make_plant, self.host, pace, own)
        self._process = multiprocessing.get_context("spawn").Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        self.bench = self._found()

    @property
    def pid(self) -> int | None:
        return self._process.pid

    def close(self) -> None:
        """End it, by force where it does not want to."""
        try:
            self.bench.ask(ask="stop")
            self._process.join(_ENDING_S)
        except ConnectionLost:
            pass
        self.bench.close()
        self._process.kill()
        self._process.join()

    def _found(self) -> Bench:
        deadline = time.monotonic() + _STARTING_S
        while True:
            try:
                return Bench(self.host)
            except ConnectionLost:
                if not self._process.is_alive() or time.monotonic() > deadline:
                    self._process.kill()
                    raise
                time.sleep(0.05)


def _serve(make_plant: Callable[[], Plant], host: str, pace: float, parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent ends it
    robot = FakeRobot(make_plant(), host, active=True, pace=pace)

    def look() -> None:
        if os.getppid() != parent:
            robot.stop()

    robot.run(look)
