"""Measure the speed of each part: `pecgrasp benchmark`; settings in conf/benchmark.yaml."""

import os
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="benchmark")
def main(cfg: DictConfig) -> None:
    # Libraries read these when they are loaded. The renderer's threads are left as a user has them.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from pec.common.atomic_files import write_json
    from pecgrasp_env.benchmark.run import run_benchmark

    results = run_benchmark(plain(cfg))
    path = Path(cfg.output) / "results.json"
    write_json(path, results)
    print(f"\nresults: {path}")
