"""Hidden folders that hold a run's outputs until all are sound, each with a lock that says whether its run still lives.

The system lets go of a lock when its process ends, however it ends. So what a killed run left behind is known to be
nobody's and is removed by the next run there; and of two runs that would write the same record, one is refused.

A folder is claimed by its file ``OWNER``: made, locked, and only then filled with the record's name and the moment at
which the folder was there. A file that is filled and not locked is that of a dead run. Nothing is renamed, which
Windows refuses for a file that is open. Of two runs the one of the earlier moment goes on. The moment is not the file's
time, which has steps of some milliseconds: a run that begins in the same step after another has looked around would
take itself for the earlier one.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError
from .file_lock import Lock, try_lock

PREFIX = ".slopewatch-part-"
OWNER = ".owner"
_ROUNDS, _WAIT_S = 20, 0.05
_MAX_UNCLAIMED_S = 60.0
"""A folder without an owner for so long was left by a run killed as it began, or by an older version."""


@contextlib.contextmanager
def part_folder(directory: Path, record: str) -> Iterator[Path]:
    """A new hidden folder in ``directory``, claimed for the run that will write ``record`` there.

    At the end it is removed if it is empty; what it holds is the caller's to move or remove. Folders of runs that no
    longer live are removed.

    Raises:
        InputError: another run that is still at work will write the same record there.
        OSError: the folder cannot be made.
    """
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=directory))
    owner = folder / OWNER
    descriptor = os.open(owner, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        lockable = _claimed(descriptor)
        began = time.time_ns()
        os.write(descriptor, f"{record}\n{began}".encode())
        if lockable:
            _look_at_others(directory, folder, record, began)
        yield folder
    finally:
        os.close(descriptor)  # before the file goes: on Windows nothing that is open can be removed
        owner.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # outputs are in it, or it is gone
            folder.rmdir()


def _claimed(descriptor: int) -> bool:
    """Lock the file of a new folder; False where the file system has no locks."""
    for _ in range(_ROUNDS):
        lock = try_lock(descriptor)
        if lock is not Lock.BUSY:
            return lock is Lock.HELD
        time.sleep(_WAIT_S)  # another run holds it for the moment in which it looks whether this one lives
    return False


def _look_at_others(directory: Path, own: Path, record: str, began: int) -> None:
    for other in sorted(directory.glob(f"{PREFIX}*")):
        if other == own or not other.is_dir():
            continue
        state = _claim_of_living(other)
        if state is None:
            shutil.rmtree(other, ignore_errors=True)
            continue
        name, _, moment = state.partition("\n")
        if name == record and (int(moment) if moment.isdigit() else 0, other.name) < (began, own.name):
            raise InputError(
                f"Another run is writing to the folder {directory}; wait until it has ended, or choose another folder."
            )


def _claim_of_living(folder: Path) -> str | None:
    """Record and moment of the folder's run, empty where that is not known yet; None if its run has ended."""
    for _ in range(_ROUNDS):
        if _claim(folder) or not _is_young(folder):
            break
        time.sleep(_WAIT_S)  # its run is between making the folder and claiming it
    try:
        with (folder / OWNER).open("r+", encoding="utf-8") as owner:
            record = owner.read()
            if not record:
                return "" if _is_young(folder) else None
            return None if try_lock(owner.fileno()) is Lock.HELD else record
    except FileNotFoundError:
        return "" if _is_young(folder) else None
    except (OSError, ValueError):
        return ""


def _claim(folder: Path) -> str:
    """What a folder is claimed with; empty before that."""
    try:
        return (folder / OWNER).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def _is_young(folder: Path) -> bool:
    try:
        return time.time() - folder.stat().st_mtime < _MAX_UNCLAIMED_S
    except OSError:
        return False
