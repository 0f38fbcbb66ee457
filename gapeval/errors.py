"""The errors that a user can mend. Everything else is a bug and keeps its traceback."""


class GapevalError(Exception):
    """One line that says what is wrong, where, and what to do about it. Exit status 1."""


class ConfigError(GapevalError):
    """A parameter or a configuration file that cannot be used. Exit status 2."""


class LogError(GapevalError):
    """A log that cannot be read, or that does not hold what was asked of it."""


class LabelError(GapevalError):
    """A label file that cannot be used."""


class DetectionsError(GapevalError):
    """A detections file that cannot be used."""
