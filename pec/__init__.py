"""PEC: classify the cloud of an object by 64 of its points."""

from pec.classifier import Classifier, Prediction
from pec.network import PEC

__all__ = ["PEC", "Classifier", "Prediction"]
