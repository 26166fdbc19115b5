"""Cut a cloud or a depth frame into objects: `pecgrasp segment FILE`; settings in conf/segment.yaml."""

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path

import hydra
import numpy as np
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from grasping import CloudError, ConfigError
from grasping.cloud_files import read_cloud
from grasping.plan_files.left_out import left_out
from grasping.plan_files.run import write_whole
from pecgrasp.from_settings import made, up_of
from pecgrasp.settings import CONF, file_as_override


@hydra.main(version_base="1.3", config_path=CONF, config_name="segment")
def segment(cfg: DictConfig) -> None:
    try:
        cloud = read_cloud(cfg.cloud) * np.float32(cfg.scale)
        segmenter, up = made(cfg.segmenter), up_of(cfg)
        started = time.perf_counter()
        scene = segmenter.segment(cloud, up=up)
    except (CloudError, ConfigError, OSError, OmegaConfBaseException) as error:
        sys.exit(f"pecgrasp segment: {str(error).splitlines()[0]}")
    milliseconds = 1e3 * (time.perf_counter() - started)
    output = Path(cfg.output)
    output.mkdir(parents=True, exist_ok=True)
    for old in output.glob("object_*.npy"):
        old.unlink()
    rows = []
    print(f"{'object':8}{'points':>8}  {'centre m':>20}  {'size mm':>14}")
    for number, points in enumerate(scene.objects, start=1):
        name = f"object_{number}"
        np.save(output / f"{name}.npy", points)
        low, high = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
        cut_off = bool(scene.touches_border[number - 1])
        confidence = scene.confidence[number - 1] if scene.confidence else None
        rows.append(
            {
                "file": f"{name}.npy",
                "points": len(points),
                "centre": ((low + high) / 2).tolist(),
                "size": (high - low).tolist(),
                "cut_off": cut_off,
                "confidence": confidence,
            }
        )
        centre = " ".join(f"{value:6.3f}" for value in (low + high) / 2)
        size = " ".join(f"{1e3 * value:4.0f}" for value in high - low)
        print(
            f"{number:<8}{len(points):>8,}  {centre:>20}  {size:>14}{'  cut off by the edge' if cut_off else ''}"
            + ("" if confidence is None else f"  one thing with {100 * confidence:.0f} %")
        )
    results = {
        "file": str(cfg.cloud),
        "segment_ms": milliseconds,
        "table": None if scene.plane is None else scene.plane.tolist(),
        "objects": rows,
        "rejected": [each.as_results() for each in scene.rejected],
        "cuts": [asdict(each) for each in scene.cuts],
    }
    write_whole(output / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")
    for line in left_out(scene):
        print(line)
    print(f"{len(rows)} objects{'' if scene.plane is not None else ', no table'}, {milliseconds:.1f} ms; in {output}")


def main() -> None:
    sys.argv[1:] = file_as_override(sys.argv[1:])
    segment()
