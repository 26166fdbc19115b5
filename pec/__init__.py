"""PEC: classify the cloud of an object by 64 of its points.

`compiled` says whether this installation has the compiled kernels of preprocessing; without them it classifies the
same, more slowly.
"""

from pec.classifier import Classifier, Prediction
from pec.kernels import AVAILABLE as compiled
from pec.network import PEC

__all__ = ["PEC", "Classifier", "Prediction", "compiled"]
