"""The one lock of this program: of a file, held by one process at a time, and given back by the system however it ends.

On POSIX systems ``flock``. On Windows ``msvcrt.locking``: there nobody may read the bytes that are locked, nor rename
or remove a file that is open. So one byte far behind the content is locked, and whoever holds a file must not rename
it.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]
try:
    import msvcrt
except ImportError:  # everywhere else
    msvcrt = None  # type: ignore[assignment]

_LOCKED_BYTE = 1 << 30
"""Place of the byte that is locked on Windows: may lie behind the end of the file."""
_HELD_ELSEWHERE = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)


class Lock(Enum):
    """What became of an attempt: ``UNKNOWN`` where the file system has no locks, as some of networks."""

    HELD = "held"
    BUSY = "busy"
    UNKNOWN = "unknown"


def try_lock(descriptor: int) -> Lock:
    """Lock an open file, without waiting; closing it, or the end of the process, gives the lock back."""
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            _lock_on_windows(descriptor)
    except OSError as error:
        return Lock.BUSY if error.errno in _HELD_ELSEWHERE else Lock.UNKNOWN
    return Lock.HELD


def _lock_on_windows(descriptor: int) -> None:
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    finally:
        os.lseek(descriptor, place, os.SEEK_SET)


@contextlib.contextmanager
def attempt(path: Path) -> Iterator[Lock]:
    """Try to hold the file ``path``, which is made and stays, until the block ends; gives what became of it.

    Raises:
        OSError: the file cannot be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        yield try_lock(descriptor)
    finally:
        os.close(descriptor)
