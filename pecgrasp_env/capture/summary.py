"""What a generated data set holds, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from pec.data.shards import read_shard
from pecgrasp_env.capture.generate import Generation

__all__ = ["summarise"]


def summarise(generation: Generation) -> dict[str, Any]:
    """The content of results.json.

    Per class: instances, clouds, the 5th, 50th and 95th percentile of the points of a cloud, the median depth (m) of
    the object's origin, or None where there is none. For all: clouds, how many this run made, rejected draws
    by reason, skipped instances and why, seconds and the speed.
    """
    manifest = generation.manifest
    shards = [read_shard(generation.directory / record.file, mapped=False) for record in manifest.shards]
    labels = np.concatenate([shard.class_index for shard in shards])
    n_points = np.concatenate([np.diff(shard.offsets) for shard in shards])
    depth = np.concatenate([shard.T_camera_object[:, 2, 3] for shard in shards])
    seen = manifest.cameras[0]["name"] != "none"
    rows = []
    for index, name in enumerate(manifest.classes):
        of_class = labels == index
        any_ = bool(of_class.any())
        rows.append(
            {
                "class": name,
                "instances": sum(instance["class"] == name for instance in manifest.instances),
                "clouds": int(of_class.sum()),
                "points": [int(value) for value in np.percentile(n_points[of_class], (5, 50, 95))] if any_ else None,
                "median_depth_m": round(float(np.median(depth[of_class])), 3) if any_ and seen else None,
            }
        )
    return {
        "classes": rows,
        "clouds": generation.n_samples,
        "new_clouds": generation.n_new,
        "rejected": generation.rejected,
        "skipped": generation.skipped,
        "seconds": round(generation.seconds, 2),
        "clouds_per_second": round(generation.n_new / generation.seconds, 1),
    }
