"""Errors that a user can cause and correct; any other exception is a bug and keeps its traceback."""


class EsfoError(Exception):
    """Base of every error that a command or node reports as one line."""


class RecordingError(EsfoError):
    """A recording is missing, damaged, empty or of a form that cannot be read."""


class CameraError(EsfoError):
    """A camera description is missing, malformed or does not fit the recording."""


class TracksError(EsfoError):
    """A tracks table is malformed."""


class OptionError(EsfoError):
    """An option has an unknown name or a value outside its range."""


class SimulationError(EsfoError):
    """A simulated scene is impossible with these options."""
