"""What can be wrong with what a user hands to `pec`."""

__all__ = ["CheckpointError", "CloudError", "ConfigError", "DatasetError", "ModelsError", "TrainingError"]


class CloudError(ValueError):
    """A cloud that cannot be classified: wrong shape, a value that is not finite, or too few points."""


class CheckpointError(ValueError):
    """A checkpoint that is missing, broken, or of another network or class list than the one expected."""


class DatasetError(ValueError):
    """A data set that is missing, broken, unfinished, or lacks a class that was asked for."""


class ConfigError(ValueError):
    """A setting that makes no sense, or settings that contradict each other."""


class TrainingError(ValueError):
    """A training run that cannot go on: its loss is not finite any more."""


class ModelsError(ValueError):
    """Models for poses that are missing, broken or contradict each other, or a name that is none of theirs."""
