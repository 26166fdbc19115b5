"""Episodes as a LeRobot data set of the format v3.0, which `lerobot` reads (its documentation: "LeRobotDataset v3.0").

FOLDER/meta/info.json                        version, fps, features, where the files lie
FOLDER/meta/stats.json                       of each feature min, max, mean, std, count and five quantiles
FOLDER/meta/tasks.parquet                    a task a row, its words as the index
FOLDER/meta/episodes/chunk-000/file-000.parquet   an episode a row: its tasks, length, rows in the data
FOLDER/data/chunk-000/file-000.parquet       a moment a row, its pictures among the rest

Pictures are of the kind "image": PNG files in the rows. Depth has 16 bits and one channel, millimetres, and is read
back as it was; a video would lose some of it.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

VERSION = "v3.0"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_FIRST = _FILE.format(chunk_index=0, file_index=0)
_CHUNK, _DATA_MB, _VIDEO_MB = 1000, 100, 200  # as the format proposes; all data go into one file
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_OWN = {"timestamp": np.float32} | dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), np.int64)


class ExportError(ValueError):
    """Episodes from which no data set can be made; the message says why."""


@dataclass(frozen=True)
class DemoEpisode:
    """task: in words. values: feature → (T, d) float32, or (T, 1) bool; the same features in all episodes. images:
    feature → a function that gives (T, H, W) uint16, which are many, so they are asked for one episode at a time.
    """

    task: str
    values: dict[str, np.ndarray]
    images: dict[str, Callable[[], np.ndarray]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))


def write_data_set(
    folder: Path, episodes: Sequence[DemoEpisode], fps: int, robot_type: str, names: dict[str, list[str]]
) -> None:
    """names: of the numbers of each feature, (d,). Raises ExportError for a folder that exists, or for no episodes."""
    if folder.exists():
        raise ExportError(f"out={folder}: is there already: name another folder, or take it away")
    if not episodes:
        raise ExportError("there is no episode to export")
    tasks = list(dict.fromkeys(each.task for each in episodes))
    columns = _columns(episodes, tasks, fps)
    (folder / "meta/episodes/chunk-000").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    pixels = _write_data(folder / "data" / _FIRST, episodes, columns)
    _write_episodes(folder / "meta/episodes" / _FIRST, episodes, columns, pixels)
    _write_tasks(folder / "meta/tasks.parquet", tasks)
    stats: dict[str, Any] = {name: _stats(values) for name, values in columns.items()}
    stats |= {name: sum(each[1:], start=each[0]).stats() for name, each in pixels.items()}
    (folder / "meta/stats.json").write_text(json.dumps(stats, indent=1) + "\n")
    info = {
        "codebase_version": VERSION,
        "robot_type": robot_type,
        "total_episodes": len(episodes),
        "total_frames": len(columns["index"]),
        "total_tasks": len(tasks),
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": _DATA_MB,
        "video_files_size_in_mb": _VIDEO_MB,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{_FILE}",
        "video_path": None,
        "features": {
            name: {"dtype": str(values.dtype), "shape": [values.shape[1]], "names": names.get(name)}
            for name, values in columns.items()
        }
        | {
            name: {"dtype": "image", "shape": [*each[0].shape, 1], "names": ["height", "width", "channels"]}
            for name, each in pixels.items()
        },
    }
    (folder / "meta/info.json").write_text(json.dumps(info, indent=1) + "\n")


def _columns(episodes: Sequence[DemoEpisode], tasks: list[str], fps: int) -> dict[str, np.ndarray]:
    """Each (N, d), of all moments of all episodes."""
    features = list(episodes[0].values)
    for number, each in enumerate(episodes):
        if list(each.images) != list(episodes[0].images):
            one, other = (", ".join(some.images) or "none" for some in (each, episodes[0]))
            raise ExportError(f"episode {number} has the pictures {one}; the first one {other}")
        if list(each.values) != features or len({len(values) for values in each.values.values()}) != 1 or not len(each):
            raise ExportError(f"episode {number} has {', '.join(each.values)}; the first one has {', '.join(features)}")
    columns = {name: np.concatenate([each.values[name] for each in episodes]) for name in features}
    frame = np.concatenate([np.arange(len(each)) for each in episodes])
    own = {
        "timestamp": frame / fps,
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(episodes)), [len(each) for each in episodes]),
        "index": np.arange(len(frame)),
        "task_index": np.repeat([tasks.index(each.task) for each in episodes], [len(each) for each in episodes]),
    }
    return columns | {name: own[name].astype(kind)[:, None] for name, kind in _OWN.items()}


def _stats(values: np.ndarray) -> dict[str, list[float]]:
    numbers = values.astype(np.float64)
    found = {"min": numbers.min(axis=0), "max": numbers.max(axis=0), "mean": numbers.mean(axis=0)}
    found |= {"std": numbers.std(axis=0), "count": np.array([len(numbers)])}
    found |= {name: np.quantile(numbers, share, axis=0) for name, share in _QUANTILES.items()}
    return {name: value.tolist() for name, value in found.items()}


@dataclass(frozen=True)
class _Pixels:
    """Of the pictures of an episode: how often each of the 65536 values occurs, how many pictures, and (H, W)."""

    counts: np.ndarray
    pictures: int
    shape: tuple[int, int]

    @classmethod
    def of(cls, images: np.ndarray) -> _Pixels:
        return cls(np.bincount(images.reshape(-1), minlength=1 << 16), len(images), images.shape[1:])

    def __add__(self, other: _Pixels) -> _Pixels:
        return _Pixels(self.counts + other.counts, self.pictures + other.pictures, self.shape)

    def stats(self) -> dict[str, Any]:
        """As `_stats`, for the one channel, (1, 1, 1)."""
        value, number = np.arange(1 << 16), self.counts.sum()
        mean = float(self.counts @ value) / number
        there, below = np.flatnonzero(self.counts), np.cumsum(self.counts)
        found = {"min": there[0], "max": there[-1], "mean": mean}
        found["std"] = np.sqrt(float(self.counts @ (value - mean) ** 2) / number)
        found |= {name: np.searchsorted(below, share * number) for name, share in _QUANTILES.items()}
        return {name: [[[float(each)]]] for name, each in found.items()} | {"count": [self.pictures]}


def _write_data(
    path: Path, episodes: Sequence[DemoEpisode], columns: dict[str, np.ndarray]
) -> dict[str, list[_Pixels]]:
    """An episode after the other; of each picture feature what its pixels are, by episode."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pixels: dict[str, list[_Pixels]] = {name: [] for name in episodes[0].images}
    writer: Any = None
    start = 0
    try:
        for number, episode in enumerate(episodes):
            rows = slice(start, start := start + len(episode))
            held = {name: _listed(values[rows]) for name, values in columns.items()}
            for name, take in episode.images.items():
                images = take()
                first = pixels[name][0].shape if pixels[name] else images.shape[1:]
                wanted = len(episode), *first
                if images.dtype != np.uint16 or images.shape != wanted:
                    given = f"{images.dtype} {images.shape}"
                    raise ExportError(f"episode {number}: {name} is {given}; uint16 {wanted} is wanted")
                pixels[name].append(_Pixels.of(images))
                held[name] = pa.array([{"bytes": each, "path": None} for each in _png(images)], _image_type())
            table = pa.table(held)
            writer = writer or pq.ParquetWriter(path, table.schema)
            writer.write_table(table)
    finally:
        if writer is not None:
            writer.close()
    return pixels


def _image_type() -> Any:
    """As the library `datasets` keeps pictures in a table."""
    import pyarrow as pa

    return pa.struct({"bytes": pa.binary(), "path": pa.string()})


def _png(images: np.ndarray) -> Iterator[bytes]:
    from PIL import Image

    for image in images:
        file = io.BytesIO()
        Image.fromarray(image).save(file, "PNG")
        yield file.getvalue()


def _write_episodes(
    path: Path,
    episodes: Sequence[DemoEpisode],
    columns: dict[str, np.ndarray],
    pixels: dict[str, list[_Pixels]],
) -> None:
    ends = np.cumsum([len(each) for each in episodes])
    rows: dict[str, list[Any]] = {
        "episode_index": list(range(len(episodes))),
        "tasks": [[each.task] for each in episodes],
        "length": [len(each) for each in episodes],
        "data/chunk_index": [0] * len(episodes),
        "data/file_index": [0] * len(episodes),
        "dataset_from_index": [int(end) - len(each) for end, each in zip(ends, episodes, strict=True)],
        "dataset_to_index": ends.tolist(),
        "meta/episodes/chunk_index": [0] * len(episodes),
        "meta/episodes/file_index": [0] * len(episodes),
    }
    for name, values in columns.items():
        each = [_stats(values[end - len(episode) : end]) for end, episode in zip(ends, episodes, strict=True)]
        rows |= {f"stats/{name}/{key}": [stats[key] for stats in each] for key in each[0]}
    for name, of_episodes in pixels.items():
        found = [each.stats() for each in of_episodes]
        rows |= {f"stats/{name}/{key}": [stats[key] for stats in found] for key in found[0]}
    _write_table(path, rows)


def _write_tasks(path: Path, tasks: list[str]) -> None:
    """As pandas writes a table whose index are the tasks' words: by that `lerobot` finds them."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    index = "__index_level_0__"
    described = {
        "index_columns": [index],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
            {"name": None, "field_name": index, "pandas_type": "unicode", "numpy_type": "object"},
        ],
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), index: pa.array(tasks, pa.string())})
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(described)}), path)


def _listed(values: np.ndarray) -> Any:
    """(N, d) as a column: plain numbers where d is 1, else lists of d."""
    import pyarrow as pa

    if values.shape[1] == 1:
        return pa.array(values[:, 0])
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _write_table(path: Path, columns: dict[str, Any]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(columns), path)
