"""What the commands that generate data share: a progress bar, shares of a job, how they end where they cannot go on."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from omegaconf import DictConfig

from pec.errors import DatasetError
from pecgrasp.progress import progress_bar
from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.common.job_share import JobShare, JobShareError
from pecgrasp_env.objects import ObjectError
from pecgrasp_env.sensor import SensorError

__all__ = ["generation_job"]


@contextmanager
def generation_job(cfg: DictConfig, command: str, unit: str) -> Iterator[dict[str, Any]]:
    """Yields `workers`, `share`, `progress` of the command's settings for the call that generates.

    unit: what is counted. An error that a user can mend ends the command with a line that says what, Ctrl-C with one
    that says how to go on.
    """
    try:
        share = None if cfg.shard is None else JobShare.parse(cfg.shard)
        with progress_bar(unit, shown=cfg.progress) as progress:
            yield {"workers": cfg.workers, "share": share, "progress": progress}
    except (CaptureError, DatasetError, JobShareError, ObjectError, SensorError) as error:
        sys.exit(f"pecgrasp {command}: {error}")
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {cfg.out}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
