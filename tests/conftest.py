"""For all tests: one core each, no deadlines, and ways to look at HTML as a parser and as a real browser sees it."""

from __future__ import annotations

import json
import math
import os
import re
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Tests run side by side, so Mesa's driver, torch and BLAS keep to one core each. A choice made outside stays.
for _threads in ("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

# A busy machine is no failure: nothing here is a timed test.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

_ENDS = pytest.StashKey[float]()


def pytest_addoption(parser: pytest.Parser) -> None:
    words = "begin no test after so many minutes: those left are skipped, each by its name"
    parser.addoption("--minutes", type=float, default=math.inf, help=words)


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ENDS] = time.monotonic() + 60 * config.getoption("minutes")


def pytest_runtest_setup(item: pytest.Item) -> None:
    if time.monotonic() >= item.config.stash[_ENDS]:
        pytest.skip(f"no time left for {item.name}")


@pytest.fixture(scope="session")
def renderer() -> Iterator[None]:
    """SAPIEN's renderer, held from test to test: with its last scene it would go, and the table of reflections, which
    takes a processor ten seconds, be computed anew at the next lit picture.
    """
    import sapien

    held = sapien.render.RenderSystem(sapien.Device("cpu"))
    yield
    del held


_VOID = {"meta", "link", "img", "input", "br", "rect", "line", "circle", "polyline"}


class _Outline(HTMLParser):
    """Fails on an element that closes in the wrong place; collects text, addresses and scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.addresses: list[str] = []
        self.ids: list[str] = []
        self.data: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        self.addresses += [named[key] or "" for key in ("src", "href", "action", "poster") if key in named]
        self.ids += [named["id"] or ""] if "id" in named else []
        if tag == "script" and named.get("type") == "application/json":
            self.data.append("")
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in _VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in _VOID:
            return
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1] == tag, f"</{tag}> closes <{self.open[-1]}>"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"script", "style"}:
            if self.open[-1] == "script" and self.data and not self.data[-1]:
                self.data[-1] = data
        else:
            self.text += data


@pytest.fixture(scope="session")
def outline() -> Callable[[str], _Outline]:
    """Parses HTML and fails where elements do not nest or do not close."""

    def parse(text: str) -> _Outline:
        parser = _Outline()
        parser.feed(text)
        parser.close()
        assert parser.open == []
        assert not re.search(r"https?://|//[a-z]+\.", text), "refers to another host"
        return parser

    return parse


class _Chromium:
    """A headless Chromium, spoken to over a pipe in the DevTools protocol."""

    def __init__(self, executable: str, profile: Path) -> None:
        commands, self._write = os.pipe()
        self._read, answers = os.pipe()
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
        options += ["--disable-background-networking", "--disable-component-update", "--hide-scrollbars"]
        command = [executable, *options, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"]
        # The protocol's pipes are file descriptors 3 and 4.
        self._process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{commands} 4>&{answers} 2>/dev/null', "bash", *command],
            pass_fds=(commands, answers),
        )
        os.close(commands)
        os.close(answers)
        self._rest = b""
        self._last = 0
        self.events: list[dict[str, Any]] = []

    def call(self, method: str, session: str | None = None, **params: Any) -> dict[str, Any]:
        self._last += 1
        message = {"id": self._last, "method": method, "params": params} | ({"sessionId": session} if session else {})
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                ready, _, _ = select.select([self._read], [], [], 60)
                block = os.read(self._read, 1 << 16) if ready else b""
                assert block, "Chromium ended or hangs"
                self._rest += block
            line, self._rest = self._rest.split(b"\0", 1)
            answer = json.loads(line)
            if answer.get("id") == self._last:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def close(self) -> None:
        os.close(self._write)
        os.close(self._read)
        self._process.terminate()
        self._process.wait(10)


class Page:
    """An open page: `run` evaluates JavaScript, awaiting promises; `console` is all that the browser complained of."""

    def __init__(self, chromium: _Chromium, address: str, width: int, height: int, dark: bool) -> None:
        self._chromium = chromium
        # A window of its own: a tab behind another one draws no frames.
        target = chromium.call("Target.createTarget", url="about:blank", newWindow=True)["targetId"]
        self._session = chromium.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url=address)
        self.run("new Promise((done) => document.readyState === 'complete' ? done() : addEventListener('load', done))")
        self.wait()

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        return self._chromium.call(method, self._session, **params)

    def run(self, script: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, frames: int = 5) -> None:
        """Let the browser draw some frames."""
        for _ in range(frames):
            self.run("new Promise((done) => requestAnimationFrame(() => done()))")

    def until(self, expression: str, frames: int = 300) -> None:
        """Let the browser draw until the expression holds; a busy machine delivers input late."""
        for _ in range(frames):
            if self.run(expression):
                return
            self.wait(1)
        raise AssertionError(f"never came true: {expression}")

    @property
    def console(self) -> list[dict[str, Any]]:
        self.wait(1)
        told = {"Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"}
        mine = [event for event in self._chromium.events if event.get("sessionId") == self._session]
        return [event for event in mine if event["method"] in told]


@pytest.fixture(scope="session")
def browse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Page]]:
    """Opens HTML in headless Chromium; skips where there is none."""
    executable = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if executable is None:
        pytest.skip("no Chromium on this machine")
    folder = tmp_path_factory.mktemp("chromium")
    chromium = _Chromium(executable, folder / "profile")

    def visit(text: str, width: int = 1000, height: int = 900, dark: bool = False) -> Page:
        path = folder / f"page{len(list(folder.glob('*.html')))}.html"
        path.write_text(text, encoding="utf-8")
        return Page(chromium, path.as_uri(), width, height, dark)

    yield visit
    chromium.close()
