"""The errors that a person can mend: what is wrong, where, and what to do.

Everything that Alight raises on purpose is an AlightError. The command line prints it as one line and ends with
exit code 2; anything else that escapes is a bug and keeps its traceback.
"""


class AlightError(Exception):
    """Something that the user can mend.

    Args:
        what: What is wrong, and where (the file, the key, the address), without a full stop.
        do: What to do about it, as an imperative without a full stop.
    """

    def __init__(self, what: str, do: str) -> None:
        self.what = what
        self.do = do
        super().__init__(f"{what}; {do}" if do else what)


class ConfigError(AlightError):
    """A configuration file is missing, is no TOML, or holds a wrong key, unit or value."""


class LandmarkError(AlightError):
    """A landmark that can't be drawn: shapes that touch or cross, or a gap too thin."""


class ImageError(AlightError):
    """A file that should be an image or a video and is not."""


class CameraError(AlightError):
    """A camera that doesn't open, or stopped giving frames."""


class CalibrationError(AlightError):
    """Views of a board, or frames at known heights, from which nothing can be calibrated."""


class AutopilotError(AlightError):
    """No autopilot on the address, a lost link, or a command that the autopilot refused."""


class OperatorError(AlightError):
    """The link to the phone can't be opened, or the phone got no answer."""


class RecorderError(AlightError):
    """A flight record that can't be written or read."""
