"""What calibration refuses."""


class CalibrationError(ValueError):
    """A board, a folder or a set of poses from which no camera's place follows; the message says the way out."""
