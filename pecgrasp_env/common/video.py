"""Films of episodes: each picture with a caption bar and, in its corner, what the wrist camera measures."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

import imageio_ffmpeg  # type: ignore[import-untyped]
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pec.common.atomic_files import replacing
from pecgrasp_env.common.depth_image import depth_picture

_BAR = 64  # pixels below the picture
_INSET_WIDTH = 168
_INK, _SOFT, _PAPER = (240, 242, 246), (160, 170, 184), (20, 24, 31)
_TONES = {"good": (58, 176, 116), "bad": (224, 96, 84), "warn": (222, 168, 64)}


class Film:
    """An H.264 film that is written frame by frame; use it as a context. The file appears when it is whole.

    fps: frames a second. Frames of one film have one size.
    """

    def __init__(self, path: Path, fps: int) -> None:
        self._fps = fps
        self._replacing = replacing(path)
        self._writer: Any = None  # imageio_ffmpeg's generator
        self._last: bytes | None = None
        self.n_frames = 0

    def __enter__(self) -> Film:
        self._temporary = self._replacing.__enter__()
        return self

    def add(self, frame: np.ndarray, seconds: float | None = None) -> None:
        """Append a frame (H, W, 3) uint8, H and W even; shown for `seconds`, or for one tick."""
        if self._writer is None:
            height, width = frame.shape[:2]
            self._writer = imageio_ffmpeg.write_frames(
                str(self._temporary),
                (width, height),
                fps=self._fps,
                codec="libx264",
                macro_block_size=2,
                quality=None,
                output_params=["-crf", "24", "-preset", "veryfast", "-g", str(2 * self._fps), "-threads", "1"],
                ffmpeg_log_level="error",
            )
            self._writer.send(None)
        self._last = np.ascontiguousarray(frame).tobytes()
        for _ in range(1 if seconds is None else max(1, round(seconds * self._fps))):
            self._writer.send(self._last)
            self.n_frames += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.close()
        self._replacing.__exit__(kind, error, trace)


def join_films(parts: Sequence[Path], path: Path) -> None:
    """One film out of several that were written alike, without encoding them again."""
    # The list's quoting: an apostrophe ends the quotes, is escaped, and opens them again.
    quoted = (str(part.resolve()).replace("'", "'\\''") for part in parts)
    with replacing(path) as temporary:
        listing = temporary.with_name("parts.txt")
        listing.write_text("".join(f"file '{part}'\n" for part in quoted))
        read = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-f", "concat", "-safe", "0", "-i", str(listing)]
        subprocess.run([*read, "-c", "copy", "-movflags", "+faststart", str(temporary)], check=True)


def compose(
    picture: np.ndarray,
    heading: str,
    stage: str,
    *,
    depth: np.ndarray | None = None,
    badge: tuple[str, str] | None = None,
) -> np.ndarray:
    """A frame of a film.

    picture: (H, W, 3) uint8. heading, stage: the two lines below it. depth: (h, w) metres, 0 for none, shown in the
    upper right corner. badge: words and tone ("good", "bad", "warn") at the right of the bar.
    Returns (H + 64, W, 3) uint8.
    """
    height, width = picture.shape[:2]
    canvas = Image.new("RGB", (width, height + _BAR), _PAPER)
    canvas.paste(Image.fromarray(np.asarray(picture, np.uint8)), (0, 0))
    draw = ImageDraw.Draw(canvas)
    draw.text((16, height + 9), heading, _INK, font=_font(20))
    draw.text((16, height + 36), stage, _SOFT, font=_font(15))
    if badge is not None:
        words, tone = badge
        font = _font(18)
        box = draw.textbbox((0, 0), words, font=font)
        left = width - 36 - (box[2] - box[0])
        draw.rounded_rectangle((left - 12, height + 15, width - 16, height + 49), 9, fill=_TONES[tone])
        draw.text((left, height + 21), words, _PAPER, font=font)
    if depth is not None:
        inset = Image.fromarray(depth_picture(depth))
        inset = inset.resize((_INSET_WIDTH, round(_INSET_WIDTH * inset.height / inset.width)))
        left, top = width - inset.width - 12, 12
        draw.rectangle((left - 2, top - 2, left + inset.width + 1, top + inset.height + 1), fill=_PAPER)
        canvas.paste(inset, (left, top))
        draw.text((left + 5, top + 3), "wrist camera, depth", _INK, font=_font(11), stroke_width=1, stroke_fill=_PAPER)
    return np.asarray(canvas)


@lru_cache(maxsize=8)
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
