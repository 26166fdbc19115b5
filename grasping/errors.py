"""Errors that a caller can act on: each message names the argument and the value that is wrong."""


class CloudError(ValueError):
    """A point cloud that cannot be used: wrong shape, not finite, too few points, not in metres."""


class ConfigError(ValueError):
    """A parameter that makes no sense: names it and its value."""
