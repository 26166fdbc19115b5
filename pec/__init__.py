"""PEC: classify the cloud of an object by 64 of its points.

`compiled` says whether this installation has the compiled kernels of preprocessing; without them it classifies the
same, more slowly.
"""

from pec.classifier import Classifier, Prediction
from pec.networks.pec import PEC
from pec.preprocessing.compiled import AVAILABLE as compiled

__all__ = ["PEC", "Classifier", "Prediction", "compiled"]
