"""A checkpoint's network as one ONNX file, for runtimes without torch: `pip install '.[onnx]'`.

The file takes `points` (batch, n_points, 3) float32 and gives `logits` (batch, n_classes). It holds the network only.
What comes before and after is in its metadata, JSON each:

preprocess     how a raw cloud becomes `points`: the settings of `pec.preprocessing.preprocess.Preprocess`.
               A pose "principal" gives the network a cloud in its four equally valid poses.
classes        names, in the order of the logits
temperature    with the poses v of one cloud: p = softmax(log(mean over v of softmax(logits_v)) / temperature)
none_of_these  whether the last logit is that of "none of these"; it is left out of log(mean …) before it is tempered
unknown_below  of `Prediction.known`, which `pec.Classifier` makes of more than the logits: not in this file

Nor is the witness of forms (`pec.known.form_witness`) in it, by which `pec.Classifier` multiplies: with
protocol.surface_forms=false a classifier is trained that is all in the file.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

import torch

from pec.checkpoint import Checkpoint
from pec.common.atomic_files import replacing
from pec.errors import ConfigError
from pec.networks.baselines import Memorising

__all__ = ["export_onnx"]


def export_onnx(checkpoint: Checkpoint, path: str | os.PathLike[str]) -> Path:
    """Write the checkpoint's network to `path`, atomically, and return the path.

    Raises ConfigError where the checkpoint is no network, ImportError where onnx or onnxscript is not installed.
    """
    if isinstance(checkpoint.model, Memorising):
        raise ConfigError(f"{checkpoint.network} is not a network: there is nothing to export")
    import onnx  # an extra

    example = 0.05 * torch.randn(2, checkpoint.preprocess.n_points, 3, generator=torch.Generator().manual_seed(0))
    values = {
        "preprocess": asdict(checkpoint.preprocess),
        "classes": checkpoint.classes,
        "temperature": checkpoint.temperature,
        "none_of_these": checkpoint.none_of_these,
        "unknown_below": checkpoint.unknown_below,
    }
    with replacing(path) as temporary:
        torch.onnx.export(
            checkpoint.model.cpu().eval(),
            (example,),
            str(temporary),
            dynamo=True,
            external_data=False,
            input_names=["points"],
            output_names=["logits"],
            dynamic_shapes=({0: torch.export.Dim("batch")},),
            verbose=False,
        )
        model = onnx.load(str(temporary))
        onnx.helper.set_model_props(model, {name: json.dumps(value) for name, value in values.items()})
        onnx.save(model, str(temporary))
    return Path(path)
