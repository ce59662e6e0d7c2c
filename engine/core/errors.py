"""The errors that SlopeWatch raises on purpose, and the exit code of each."""

from __future__ import annotations

from ...interface.protocol import CANCELLED, INPUT_REFUSED, INTERNAL_FAILURE
from .messages import of_final_files


class SlopeWatchError(Exception):
    """Base of every error that SlopeWatch raises on purpose. ``exit_code`` is the program's.

    The message names files as the user knows them, see ``of_final_files``.
    """

    exit_code = INTERNAL_FAILURE

    def __init__(self, message: str = "") -> None:
        super().__init__(of_final_files(message))


class InputError(SlopeWatchError):
    """Something the user gave cannot be used.

    The message is one sentence that names the file or field and the remedy.
    """

    exit_code = INPUT_REFUSED


class EngineError(SlopeWatchError):
    """The engine itself failed (a native program crashed, an output did not validate)."""

    exit_code = INTERNAL_FAILURE


class Cancelled(SlopeWatchError):
    """The user asked to stop; nothing half-written is left."""

    exit_code = CANCELLED
