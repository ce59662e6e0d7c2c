"""Hidden folders that hold a run's outputs until all are sound, each with a lock that says whether its run still lives.

The system lets go of a lock when its process ends, however it ends. So what a killed run left behind is known to be
nobody's: the next command that looks there undoes what that run had half replaced (``journal``), and removes the rest.
Of two runs that would write the same record, one is refused.

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
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError
from .file_lock import Lock, try_lock
from .journal import ASIDE, ELSEWHERE, JOURNAL, Journal, elsewhere, other_parts

PREFIX = ".slopewatch-part-"
OWNER = ".owner"
HOLDING = (JOURNAL, ELSEWHERE)
"""Files with which a part folder must not be removed: it holds the earlier files of a replacement that is half done."""
_ROUNDS, _WAIT_S = 20, 0.05
_MAX_MOVING_S = 30.0
"""That is waited for a living run to give its files their names."""
_of_this_process: set[Path] = set()
_MAX_UNCLAIMED_S = 60.0
"""A folder without an owner for so long was left by a run killed as it began, or by an older version."""


@contextlib.contextmanager
def part_folder(directory: Path, record: str) -> Iterator[Path]:
    """A new hidden folder in ``directory``, claimed for the run that will write ``record`` there.

    At the end it is removed if it is empty; what it holds is the caller's to move or remove. What runs left that no
    longer live is undone and removed.

    Raises:
        InputError: another run that is still at work will write the same record there.
        OSError: the folder cannot be made.
    """
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=directory))
    owner = folder / OWNER
    descriptor = os.open(owner, os.O_RDWR | os.O_CREAT, 0o644)
    _of_this_process.add(folder)
    try:
        lockable = _claimed(descriptor)
        began = time.time_ns()
        os.write(descriptor, f"{record}\n{began}".encode())
        if lockable:
            _look_at_others(directory, folder, record, began)
        yield folder
    finally:
        _of_this_process.discard(folder)
        os.close(descriptor)  # before the file goes: on Windows nothing that is open can be removed
        if not _is_held(folder):
            _remove(owner)
        with contextlib.suppress(OSError):  # outputs are in it, or it is gone
            folder.rmdir()


def _remove(owner: Path) -> None:
    """Remove a file, unless others keep it open (Windows): then the next run removes it."""
    for _ in range(_ROUNDS):
        with contextlib.suppress(PermissionError):
            owner.unlink(missing_ok=True)
            return
        time.sleep(_WAIT_S)  # another run looks whether this one lives


def _claimed(descriptor: int) -> bool:
    """Lock the file of a new folder; False where the file system has no locks."""
    for _ in range(_ROUNDS):
        lock = try_lock(descriptor)
        if lock is not Lock.BUSY:
            return lock is Lock.HELD
        time.sleep(_WAIT_S)  # another run holds it for the moment in which it looks whether this one lives
    return False


def settle(directory: Path) -> None:
    """Undo what killed runs had half replaced in a folder, and remove what they left; to be called before any reading.

    The folders of living runs are left alone. While one of them gives its files their names, this waits.

    Raises:
        InputError: the earlier files cannot be put back, or a living run takes too long.
    """
    for folder in _part_folders(Path(directory)):
        _settled(folder)


def settle_around(path: Path) -> None:
    """``settle`` wherever the results may lie that a path belongs to: a folder, or a file in one or in its subfolder.

    Raises:
        InputError: as ``settle``.
    """
    place = Path(path).absolute()
    for folder in (place, *list(place.parents)[:2]):
        settle(folder)


def _part_folders(directory: Path) -> list[Path]:
    with contextlib.suppress(OSError, ValueError):  # what a path is that names no folder, its reader says
        return [folder for folder in sorted(directory.glob(f"{PREFIX}*")) if _is_ours(folder)]
    return []


def _look_at_others(directory: Path, own: Path, record: str, began: int) -> None:
    for other in _part_folders(directory):
        if other == own:
            continue
        name, _, moment = (_settled(other) or "").partition("\n")
        if name == record and (int(moment) if moment.isdigit() else 0, other.name) < (began, own.name):
            raise InputError(_busy(directory))


def _busy(directory: Path) -> str:
    return f"Another run is writing to the folder {directory}; wait until it has ended, or choose another folder."


def _settled(folder: Path) -> str | None:
    """Record and moment of the folder's run, empty where that is not known yet; None if its run had ended.

    Then what it had half replaced is undone, and the folder is gone.
    """
    end = time.monotonic() + _MAX_MOVING_S
    while (claim := _claim_of_living(folder)) is not None and _is_held(folder):
        if time.monotonic() > end:
            raise InputError(_busy(folder.parent))
        time.sleep(_WAIT_S)
    if claim is None and not _is_held(folder):
        shutil.rmtree(folder, ignore_errors=True)
    return claim


def _claim_of_living(folder: Path) -> str | None:
    """As ``_settled``; of a run that has ended the folder stays."""
    for _ in range(_ROUNDS):
        if _claim(folder) or not _is_beginning(folder):
            break
        time.sleep(_WAIT_S)  # its run is between making the folder and claiming it
    if folder in _of_this_process:  # file systems whose locks are those of a process would give it once more
        return _claim(folder)
    with contextlib.ExitStack() as stack:
        try:
            owner = stack.enter_context((folder / OWNER).open("r+", encoding="utf-8"))
            record = owner.read()
            if not record and _is_beginning(folder):
                return ""
            lock = try_lock(owner.fileno())
        except FileNotFoundError:
            if _is_beginning(folder):
                return ""
            record, lock = "", Lock.HELD  # nobody can hold it
        except (OSError, ValueError) as error:
            if _is_held(folder):
                raise _not_undone(folder, error) from error
            return ""
        if lock is Lock.BUSY or (lock is Lock.UNKNOWN and (_is_young(folder) or not _is_held(folder))):
            return record
        try:
            _undo(folder)  # as long as the lock is held, nobody else does
        except OSError as error:
            raise _not_undone(folder, error) from error
    return None


def _not_undone(folder: Path, error: Exception) -> InputError:
    reason = error.strerror if isinstance(error, OSError) else error
    return InputError(
        f"A run was killed while it replaced results in {folder.parent}, and the earlier ones cannot be put back "
        f"({reason}); make the folder writable."
    )


def _undo(folder: Path) -> None:
    """Undo what the run of a part folder had half replaced, which has ended."""
    main = elsewhere(folder)
    if main is None:
        others = other_parts(folder)
        if (folder / JOURNAL).exists():
            Journal.read(folder).undo()
        for part in others:  # before this folder goes, which says whether the replacement was done
            if part.name.startswith(PREFIX) and _is_ours(part):
                _settled(part)
        return
    if main.name.startswith(PREFIX) and (main / JOURNAL).exists():
        _settled(main)
        if (main / JOURNAL).exists():
            return
    # Where the other folder is gone while files are still set aside here, somebody has moved it: they are kept.
    if main.is_dir() or not any((folder / ASIDE).glob("*")):
        (folder / ELSEWHERE).unlink(missing_ok=True)


def _is_ours(folder: Path) -> bool:
    """False for no folder, and for that of another user in one that all users share: its journal could be a trap."""
    try:
        inside, directory = folder.lstat(), folder.parent.stat()
    except FileNotFoundError:  # its run has just ended
        return False
    shared = directory.st_mode & stat.S_ISVTX and inside.st_uid not in (directory.st_uid, os.geteuid())
    return stat.S_ISDIR(inside.st_mode) and not shared


def _is_held(folder: Path) -> bool:
    return any((folder / name).exists() for name in HOLDING)


def _claim(folder: Path) -> str:
    """What a folder is claimed with; empty before that."""
    try:
        return (folder / OWNER).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def _is_beginning(folder: Path) -> bool:
    """Whether the folder's run may be about to claim it: nothing else is in it before."""
    with contextlib.suppress(OSError):
        return _is_young(folder) and not any(path.name != OWNER for path in folder.iterdir())
    return False


def _is_young(folder: Path) -> bool:
    try:
        return time.time() - folder.stat().st_mtime < _MAX_UNCLAIMED_S
    except OSError:
        return False
