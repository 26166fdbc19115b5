"""The one error of this package."""


class ObjectError(ValueError):
    """An object that cannot be had: unknown class or instance, empty folder, broken mesh, absurd size.

    The message names what was asked for and where it was looked for.
    """
