"""Errors of the data room that a user can mend: what was found, what was expected, what to do."""


class LogError(Exception):
    """A log cannot be read, written or accepted as a record; the text is the whole sentence, path included."""


class LogTooLargeError(LogError):
    """The columns of a log do not fit into memory."""


class UnitError(ValueError):
    """A quantity or unit cannot be understood; the text is the whole sentence."""
