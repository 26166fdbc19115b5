"""Films: as long as was asked for, whole or not there, joined without a gap."""

from __future__ import annotations

from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from pecgrasp_env.common.depth_image import depth_picture
from pecgrasp_env.common.video import Film, compose, join_films


def frame(brightness: int) -> np.ndarray:
    return np.full((64, 96, 3), brightness, np.uint8)


def film(path: Path, n: int, brightness: int) -> Path:
    with Film(path, 10) as written:
        for _ in range(n):
            written.add(frame(brightness))
    return path


def pictures(path: Path) -> list[np.ndarray]:
    reader = imageio_ffmpeg.read_frames(str(path))
    width, height = next(reader)["size"]
    return [np.frombuffer(data, np.uint8).reshape(height, width, 3) for data in reader]


def test_joined_films_show_all_their_frames_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "a person's folder"
    folder.mkdir()
    parts = [film(folder / "1.mp4", 5, 40), film(folder / "2.mp4", 7, 200)]
    join_films(parts, folder / "all.mp4")
    shown = [picture.mean() for picture in pictures(folder / "all.mp4")]
    assert len(shown) == 12
    assert shown == pytest.approx([40] * 5 + [200] * 7, abs=4)
    assert sorted(path.name for path in folder.iterdir()) == ["1.mp4", "2.mp4", "all.mp4"]


def test_a_picture_stays_as_long_as_it_is_told_to(tmp_path: Path) -> None:
    with Film(tmp_path / "film.mp4", 10) as written:
        written.add(frame(90))
        written.add(frame(90), 1.5)
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4"))[0] == 16


def test_a_film_that_is_broken_off_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with Film(tmp_path / "film.mp4", 10) as written:
            written.add(frame(90))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_frame_keeps_the_picture_and_adds_what_was_asked_for() -> None:
    picture = np.full((240, 424, 3), 77, np.uint8)
    depth = np.full((240, 424), 0.5)
    plain = compose(picture, "heading", "stage")
    full = compose(picture, "heading", "stage", depth=depth, badge=("lifted", "good"))
    assert plain.shape == full.shape == (304, 424, 3)
    assert np.all(plain[:240] == 77)
    assert np.all(full[120:240, :200] == 77)
    assert not np.all(full[:100, 250:] == 77)  # the inset
    assert np.any(full[240:] != plain[240:])  # the badge


def test_near_is_brighter_than_far_and_nothing_is_black() -> None:
    drawn = depth_picture(np.array([[0.4, 0.6], [0.0, 0.8]])).sum(axis=2)
    assert drawn[0, 0] > drawn[0, 1] > drawn[1, 1] > drawn[1, 0] == 0
    assert not depth_picture(np.zeros((2, 2))).any()
