"""Temporary files: the one place that makes them, in folders that the next run removes if this one is killed.

A folder holds a file ``OWNER`` that its process keeps locked. The system gives the lock back when the process ends,
however it ends. So a folder with a lock that can be had is a dead run's. Whoever makes a folder looks, after locking,
whether it is still there: another run may have taken it for a dead one between its making and its locking.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from . import cancellation
from .errors import EngineError, InputError
from .file_lock import Lock, try_lock
from .messages import shown

VARIABLE = "SLOPEWATCH_TMP"
PREFIX = "slopewatch-temporary-"
OWNER = ".owner"
_ATTEMPTS = 100
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_SPARE_BYTES = 16_384
"""Bytes: owner, names and small files of a folder."""
_NEARLY_FULL_BYTES = 262_144
"""Bytes: a step that fails with less left than this most likely failed for that."""
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0)


def choose(folder: Path) -> None:
    """Have this process and its children make their temporary files in ``folder``.

    Raises:
        InputError: it is no folder that can be written.
    """
    folder = folder.absolute()
    _refuse_unusable(folder)
    os.environ[VARIABLE] = str(folder)


def base_folder() -> Path:
    """Where temporary folders are made: as chosen, else the variable's folder, else the system's.

    Raises:
        InputError: it is no folder that can be written.
    """
    try:
        base = Path(os.environ.get(VARIABLE, "") or tempfile.gettempdir()).absolute()
    except FileNotFoundError as error:
        raise InputError(
            "This system has no temporary folder that can be written; choose another one (--temporary-folder)."
        ) from error
    _refuse_unusable(base)
    return base


@contextlib.contextmanager
def temporary_folder(purpose: str, *, needed_bytes: int = 0, base: Path | None = None) -> Iterator[Path]:
    """A new folder that only this user can read; it goes when the block is left and when the command is cancelled.

    Folders that killed runs of this user left beside it are removed first.

    Args:
        purpose: a word for its name.
        needed_bytes: what will be written into it, as far as it is known.
        base: where to make it, if not in ``base_folder()``.

    Raises:
        InputError: the folder cannot be made, or its disk is full before or during the block.
    """
    base = base_folder() if base is None else base
    remove_dead(base)
    free = _free_bytes(base)
    if needed_bytes + _SPARE_BYTES > free:
        raise InputError(
            f"The temporary folder {shown(base)} has {free / 1e6:.2f} MB left, and "
            f"{(needed_bytes + _SPARE_BYTES) / 1e6:.2f} MB are needed; free some space, or choose another one "
            "(--temporary-folder)."
        )
    with contextlib.ExitStack() as stack:
        with cancellation.uninterrupted():
            folder, descriptor = _claimed(base, purpose)
            stack.enter_context(cancellation.temporary(folder))
            stack.callback(os.close, descriptor)  # first: on Windows nothing that is open can be removed
        try:
            yield folder
        except (OSError, EngineError) as error:
            _blame_full_disk(base, folder, error)
            raise


def unnamed_file(content: bytes) -> IO[bytes]:
    """A temporary file without a name that holds ``content``, to be read from its beginning.

    Raises:
        InputError: it cannot be written.
    """
    base = base_folder()
    try:
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(tempfile.TemporaryFile(dir=base))
            file.write(content)
            file.seek(0)
            stack.pop_all()
            return file
    except OSError as error:
        raise _unusable(base, error) from error


def remove_dead(base: Path) -> None:
    """Remove the folders in ``base`` that killed runs of this user left; what cannot be looked at stays."""
    try:
        with os.scandir(base) as entries:
            names = [entry.name for entry in entries if entry.name.startswith(PREFIX)]
    except OSError:
        return
    for name in names:
        with contextlib.suppress(OSError):
            _remove_if_dead(base / name)


def _remove_if_dead(folder: Path) -> None:
    if not _is_own(folder):
        return
    try:
        descriptor = os.open(folder / OWNER, os.O_RDWR | _NO_LINKS)
    except FileNotFoundError:
        folder.rmdir()  # a run ended, or is, between making and claiming it: it is empty, or no folder of ours
        return
    try:
        if try_lock(descriptor) is not Lock.HELD:
            return
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(descriptor)
    if os.name != "posix":  # what was open
        shutil.rmtree(folder, ignore_errors=True)


def _is_own(folder: Path) -> bool:
    """Whether it is a folder, no link, of this user and for this user alone."""
    about = folder.lstat()
    if os.name != "posix":
        return stat.S_ISDIR(about.st_mode)
    return stat.S_ISDIR(about.st_mode) and about.st_uid == os.geteuid() and not stat.S_IMODE(about.st_mode) & 0o077


def _claimed(base: Path, purpose: str) -> tuple[Path, int]:
    """A new folder and the locked file in it, open."""
    for _ in range(_ATTEMPTS):
        folder, descriptor = None, None
        try:
            folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{purpose}-", dir=base))
            descriptor = os.open(folder / OWNER, os.O_RDWR | os.O_CREAT | os.O_EXCL | _NO_LINKS, 0o600)
            if try_lock(descriptor) is not Lock.BUSY and os.path.samestat(os.fstat(descriptor), _about(folder)):
                return folder, descriptor
        except FileNotFoundError:  # another run has just removed it
            _refuse_unusable(base)
        except OSError as error:
            with contextlib.suppress(OSError):
                if folder is not None:
                    folder.rmdir()
            raise _unusable(base, error) from error
        if descriptor is not None:
            os.close(descriptor)
    raise EngineError(f"no temporary folder could be made in {base}")


def _about(folder: Path) -> os.stat_result:
    return (folder / OWNER).lstat()


def _refuse_unusable(base: Path) -> None:
    if not base.is_dir():
        raise InputError(
            f"The temporary folder {shown(base)} does not exist; create it, or choose another one (--temporary-folder)."
        )
    if not os.access(base, os.W_OK | os.X_OK):
        raise InputError(
            f"The temporary folder {shown(base)} cannot be written; choose another one (--temporary-folder)."
        )


def _unusable(base: Path, error: OSError) -> InputError:
    reason = error.strerror or str(error)
    return InputError(
        f"The temporary folder {shown(base)} cannot be used ({reason}); check its rights and free some space, or "
        "choose another one (--temporary-folder)."
    )


def _free_bytes(base: Path) -> int:
    try:
        return shutil.disk_usage(base).free
    except OSError as error:
        raise _unusable(base, error) from error


def _blame_full_disk(base: Path, folder: Path, error: Exception) -> None:
    """Raise InputError if what failed most likely did not fit; numpy and child processes do not report it as such."""
    name = getattr(error, "filename", None)
    if isinstance(name, (str, bytes)) and not Path(os.fsdecode(name)).is_relative_to(folder):
        return  # of another place
    full = isinstance(error, OSError) and error.errno in _NO_SPACE
    if full or _free_bytes(base) < _NEARLY_FULL_BYTES:
        raise InputError(
            f"Writing to the temporary folder {shown(base)} failed, as its disk is full; free some space, or choose "
            "another one (--temporary-folder)."
        ) from error
