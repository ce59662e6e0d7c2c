"""The lock of ``interface.file_lock`` with the engine's error: a file that another process holds is refused."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from ...interface.file_lock import Lock, attempt, try_lock
from .errors import InputError

__all__ = ["Lock", "locked", "try_lock"]


@contextlib.contextmanager
def locked(path: Path, sentence: str) -> Iterator[None]:
    """Hold the file ``path``, which is made and stays; goes on without a lock where the file system has none.

    Raises:
        InputError: with ``sentence``: another process holds it.
    """
    with attempt(path) as lock:
        if lock is Lock.BUSY:
            raise InputError(sentence)
        yield
