"""Hidden folders that hold a run's outputs until all are sound, each with a lock that says whether its run still lives.

The system lets go of a lock when its process ends, however it ends. So what a killed run left behind is known to be
nobody's and is removed by the next run there; and of two runs that would write the same record, one is refused.
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

try:
    import fcntl
except ImportError:  # Windows: nothing is known of other runs
    fcntl = None  # type: ignore[assignment]

PREFIX = ".slopewatch-part-"
OWNER = ".owner"
_NEW = ".owner-new"
_ROUNDS, _WAIT_S = 20, 0.05
_MAX_UNCLAIMED_S = 60.0
"""A folder without an owner's file for so long was left by a run killed as it began, or by an older version."""


@contextlib.contextmanager
def part_folder(directory: Path, record: str) -> Iterator[Path]:
    """A new hidden folder in ``directory``, claimed for the run that will write ``record`` there; not removed here.

    Folders of runs that no longer live are removed.

    Raises:
        InputError: another run that is still at work will write the same record there.
        OSError: the folder cannot be made.
    """
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=directory))
    if fcntl is None:
        yield folder
        return
    with (folder / _NEW).open("w", encoding="utf-8") as own:
        own.write(record)
        own.flush()
        lockable = _locked(own.fileno())
        # under its name only once it is locked, so that nobody takes it for that of a dead run
        os.replace(folder / _NEW, folder / OWNER)
        try:
            if lockable:
                _look_at_others(directory, folder, record)
        except InputError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        yield folder
        (folder / OWNER).unlink(missing_ok=True)


def _locked(descriptor: int) -> bool:
    """Whether the lock was free and is held now; some network file systems have none."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _look_at_others(directory: Path, own: Path, record: str) -> None:
    mine = _age_key(own)
    for other in sorted(directory.glob(f"{PREFIX}*")):
        if other == own or not other.is_dir():
            continue
        state = _record_of_living(other)
        if state is None:
            shutil.rmtree(other, ignore_errors=True)
        elif state == record and _age_key(other) < mine:
            raise InputError(
                f"Another run is writing to the folder {directory}; wait until it has ended, or choose another folder."
            )


def _age_key(folder: Path) -> tuple[int, str]:
    """Smaller for the run that began first; both of two that begin together find the same."""
    try:
        return (folder / OWNER).stat().st_mtime_ns, folder.name
    except OSError:
        return 2**63, folder.name


def _record_of_living(folder: Path) -> str | None:
    """The record that the folder's run will write, empty where that is not known yet; None if its run has ended."""
    for _ in range(_ROUNDS):
        if (folder / OWNER).exists() or not _is_young(folder):
            break
        time.sleep(_WAIT_S)  # its run is between making the folder and claiming it
    try:
        with (folder / OWNER).open(encoding="utf-8") as owner:
            return None if _locked(owner.fileno()) else owner.read()
    except FileNotFoundError:
        return "" if _is_young(folder) else None
    except (OSError, ValueError):
        return ""


def _is_young(folder: Path) -> bool:
    try:
        return time.time() - folder.stat().st_mtime < _MAX_UNCLAIMED_S
    except OSError:
        return False
