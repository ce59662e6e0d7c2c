"""The errors that SlopeWatch raises on purpose, and the exit code of each."""

from __future__ import annotations


class SlopeWatchError(Exception):
    """Base of every error that SlopeWatch raises on purpose. ``exit_code`` is the program's."""

    exit_code = 1


class InputError(SlopeWatchError):
    """Something the user gave cannot be used.

    The message is one sentence that names the file or field and the remedy.
    """

    exit_code = 2


class EngineError(SlopeWatchError):
    """The engine itself failed (a native program crashed, an output did not validate)."""

    exit_code = 1


class Cancelled(SlopeWatchError):
    """The user asked to stop; nothing half-written is left."""

    exit_code = 130
