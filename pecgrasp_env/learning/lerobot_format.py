"""Episodes as a LeRobot data set of the format v3.0, which `lerobot` reads (its documentation: "LeRobotDataset v3.0").

FOLDER/meta/info.json                        version, fps, features, where the files lie
FOLDER/meta/stats.json                       of each feature min, max, mean, std, count and five quantiles
FOLDER/meta/tasks.parquet                    a task a row, its words as the index
FOLDER/meta/episodes/chunk-000/file-000.parquet   an episode a row: its tasks, length, rows in the data
FOLDER/data/chunk-000/file-000.parquet       a moment a row
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
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
    """task: in words. values: feature → (T, d) float32, or (T, 1) bool; the same features in all episodes."""

    task: str
    values: dict[str, np.ndarray]

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
    _write_table(folder / "data" / _FIRST, {name: _listed(values) for name, values in columns.items()})
    _write_episodes(folder / "meta/episodes" / _FIRST, episodes, columns)
    _write_tasks(folder / "meta/tasks.parquet", tasks)
    stats = {name: _stats(values) for name, values in columns.items()}
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
        },
    }
    (folder / "meta/info.json").write_text(json.dumps(info, indent=1) + "\n")


def _columns(episodes: Sequence[DemoEpisode], tasks: list[str], fps: int) -> dict[str, np.ndarray]:
    """Each (N, d), of all moments of all episodes."""
    features = list(episodes[0].values)
    for number, each in enumerate(episodes):
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


def _write_episodes(path: Path, episodes: Sequence[DemoEpisode], columns: dict[str, np.ndarray]) -> None:
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
