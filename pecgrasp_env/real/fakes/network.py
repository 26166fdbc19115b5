"""All sockets of a stand-in, served by one thread between two steps of the plant; and what a bad cable does to them."""

from __future__ import annotations

import selectors
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Any

_READ_BYTES = 1 << 16


class Connection:
    """One client. Subclasses say in `received` what to do with what it sends."""

    def __init__(self, network: Network, client: socket.socket) -> None:
        self.network, self.socket = network, client
        self._waiting: deque[tuple[float, bytes]] = deque()

    def received(self, data: bytes) -> None:
        raise NotImplementedError

    def send(self, data: bytes) -> None:
        """As soon as the cable lets it through."""
        due = time.monotonic() + self.network.lag
        halves = [data[: len(data) // 2], data[len(data) // 2 :]] if self.network.cut else [data]
        for k, part in enumerate(halves):
            self._waiting.append((due + k * self.network.cut_s, part))
        self.flush()

    def flush(self) -> None:
        """Send what is due."""
        while self._waiting and not self.network.silent and self._waiting[0][0] <= time.monotonic():
            due, data = self._waiting.popleft()
            try:
                sent = self.socket.send(data)
            except BlockingIOError:
                sent = 0
            except OSError:
                self.close()
                return
            if sent < len(data):
                self._waiting.appendleft((due, data[sent:]))
                return

    @property
    def next_due(self) -> float | None:
        return self._waiting[0][0] if self._waiting else None

    def close(self) -> None:
        self.network.forget(self)
        self._waiting.clear()


class LineConnection(Connection):
    """A client that speaks in lines; subclasses answer each in `answer`, None for no answer."""

    def __init__(self, network: Network, client: socket.socket) -> None:
        super().__init__(network, client)
        self._rest = b""

    def received(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            answer = self.answer(line.decode(errors="replace").strip())
            if answer is not None:
                self.send(answer)

    def answer(self, line: str) -> bytes | None:
        raise NotImplementedError


class Network:
    """lag: s that everything it sends is late. cut: packets arrive in two halves, cut_s apart, which is to be less than
    a period: `ur_rtde` passes over a packet when the next one has begun. silent: a pulled cable.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self.lag, self.cut, self.silent = 0.0, False, False
        self.cut_s = 0.003
        self.connections: list[Connection] = []
        self._selector = selectors.DefaultSelector()
        self._listeners: list[socket.socket] = []

    def listen(self, port: int, make: Callable[[Network, socket.socket], Connection]) -> None:
        """Raises OSError where the port is taken."""
        listener = socket.create_server((self.host, port))
        listener.setblocking(False)
        self._listeners.append(listener)
        self._selector.register(listener, selectors.EVENT_READ, make)

    def serve(self, until: float) -> None:
        """Read, answer and send until ``until`` of the monotonic clock, and at least once."""
        while True:
            for connection in list(self.connections):
                connection.flush()
            dues = [due for each in self.connections if (due := each.next_due) is not None]
            first = until if self.silent else min([until, *dues])
            for key, _ in self._selector.select(max(0.0, first - time.monotonic())):
                self._ready(key.fileobj, key.data)
            if time.monotonic() >= until:
                return

    def _ready(self, ready: Any, data: Any) -> None:
        if ready in self._listeners:
            client, _ = ready.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection = data(self, client)
            self.connections.append(connection)
            self._selector.register(client, selectors.EVENT_READ, connection)
            return
        try:
            received = ready.recv(_READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            received = b""
        if not received:
            data.close()
        elif not self.silent:  # what is sent into a pulled cable never arrives
            data.received(received)

    def forget(self, connection: Connection) -> None:
        """Close one client's socket."""
        if connection in self.connections:
            self.connections.remove(connection)
            self._selector.unregister(connection.socket)
            connection.socket.close()

    def drop(self) -> None:
        """Close all clients' sockets; they may connect again."""
        for connection in list(self.connections):
            connection.close()

    def close(self) -> None:
        self.drop()
        for listener in self._listeners:
            self._selector.unregister(listener)
            listener.close()
        self._selector.close()
