"""Ways to look at the HTML that the project writes: as a parser sees it, and as a real browser does."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

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


@pytest.fixture
def browse(tmp_path: Path) -> Callable[..., tuple[str, list[str]]]:
    """Opens a page in headless Chromium, in a window of some height, and returns its document and its console's lines."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")

    def visit(text: str, height: int = 900) -> tuple[str, list[str]]:
        page = tmp_path / "page.html"
        page.write_text(text, encoding="utf-8")
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
        options += ["--disable-background-networking", "--disable-component-update", "--enable-logging=stderr"]
        options += [
            f"--user-data-dir={tmp_path / 'profile'}",
            f"--window-size=1000,{height}",
            "--virtual-time-budget=4000",
        ]
        done = subprocess.run(
            [browser, *options, "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=60, check=True
        )
        return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    return visit
