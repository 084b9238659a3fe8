"""Exceptions and warnings."""


class Error(Exception):
    """Anything that the renderer refuses or fails at. The message is that of the command line, with file and place."""


class OptionError(Error, ValueError):
    """An option or an argument is out of range, or contradicts another."""


class FormatError(Error, ValueError):
    """The content of a file breaks its format, or asks for something that is not supported."""


class FileError(Error, OSError):
    """The system refused to read or write a file."""


class NotFoundError(FileError, FileNotFoundError):
    """A file, or one that a scene names, is not there."""


class SceneWarning(UserWarning):
    """Something in a scene is done in another way than it may have been meant."""


class CheckpointWarning(RuntimeWarning):
    """A checkpoint could not be written; the picture is whole all the same."""
