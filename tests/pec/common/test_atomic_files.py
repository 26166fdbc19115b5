"""Files and directories that are there whole or not at all."""

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pec.common.atomic_files import current_directory, replacing, replacing_directory, write_json, write_whole


def test_content_replaces_what_was_there_and_folders_are_made(tmp_path):
    path = tmp_path / "a" / "b" / "file.txt"
    write_whole(path, "größer")
    assert path.read_bytes() == "größer".encode()
    write_whole(path, b"\x00\x01")
    assert path.read_bytes() == b"\x00\x01"
    write_json(path, {"a": [1, 2]}, indent=None)
    assert path.read_text() == '{"a": [1, 2]}\n'
    assert os.listdir(path.parent) == ["file.txt"]


def test_file_may_be_read_by_whom_a_plain_one_may(tmp_path):
    (tmp_path / "plain").write_text("")
    write_whole(tmp_path / "whole", "")
    assert (tmp_path / "whole").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_failed_block_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "file"
    write_whole(path, "old")
    with contextlib.suppress(KeyboardInterrupt), replacing(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    with replacing(path):
        pass  # wrote nothing
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


def test_a_full_disk_is_named_with_the_file(tmp_path, monkeypatch):
    def full(path: Path, data: bytes) -> int:
        with open("/dev/full", "wb", buffering=0) as file:
            return file.write(data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match=r"file\.json") as caught:
        write_json(tmp_path / "file.json", {})
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(tmp_path / "file.json"))
    assert not os.listdir(tmp_path)


def test_directory_appears_whole_and_does_not_replace_another(tmp_path):
    for content in ("first", "second"):
        try:
            with replacing(tmp_path / "folder") as temporary:
                temporary.mkdir()
                (temporary / "file").write_text(content)
        except OSError:
            assert content == "second"
    assert (tmp_path / "folder" / "file").read_text() == "first"
    assert os.listdir(tmp_path) == ["folder"]


def test_directory_is_replaced_with_all_that_it_held(tmp_path):
    directory = tmp_path / "folder"
    for name in ("old", "new"):
        with replacing_directory(directory) as new:
            (new / name).write_text(name)
    with contextlib.suppress(KeyboardInterrupt), replacing_directory(directory) as new:
        (new / "half").write_text("")
        raise KeyboardInterrupt
    assert current_directory(directory) == directory
    assert os.listdir(directory) == ["new"]


def test_killed_writer_of_a_directory_leaves_a_whole_one(tmp_path):
    code = f"""
from pec.common.atomic_files import replacing_directory
for number in range(10**9):
    with replacing_directory({str(tmp_path / "folder")!r}) as new:
        for name in "ab":
            (new / name).write_text(str(number))
"""
    for _ in range(3):
        process = subprocess.Popen([sys.executable, "-c", code])
        deadline = time.monotonic() + 60
        while not (tmp_path / "folder").exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.001)
        time.sleep(0.05)  # wherever it is then
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        there = current_directory(tmp_path / "folder")
        a, b = (json.loads((there / name).read_text()) for name in "ab")
        assert a == b
