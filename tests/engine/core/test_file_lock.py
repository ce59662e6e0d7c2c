"""The lock of files: of one holder at a time, given back at the end, on POSIX systems and as on Windows.

Windows itself is not at hand. What stands for it follows the documented ways of ``msvcrt.locking`` and of open files
there: bytes are locked from the file's position on, for one open file at a time; locked bytes cannot be read; a file
that is open cannot be renamed or removed.
"""

from __future__ import annotations

import errno
import os
import shutil
import struct
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.file_lock import Lock, locked, try_lock
from slopewatch.engine.core.part_folders import OWNER, part_folder
from slopewatch.engine.core.staged_outputs import staged_outputs
from slopewatch.interface import file_lock

fcntl = pytest.importorskip("fcntl")
_LAYOUT = "hhlli4x"  # of struct flock with 64-bit offsets: type, whence, start, length, process


def locking(descriptor: int, mode: int, count: int) -> None:
    """``msvcrt.locking`` by locks of open files (Linux): of bytes from the position on, and of this open file alone."""
    assert mode == 2
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    assert place >= os.fstat(descriptor).st_size, "others could not read what is locked"
    wanted = struct.pack(_LAYOUT, fcntl.F_WRLCK, os.SEEK_SET, place, count, 0)
    try:
        fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, wanted)
    except OSError as error:
        raise PermissionError(errno.EACCES, "Permission denied") from error


def refusing(work: Callable[..., Any]) -> Callable[..., Any]:
    """A function on paths that refuses those of files that are open in this process, as Windows does."""

    def refuse(path: Any, *more: Any, **named: Any) -> Any:
        if not isinstance(path, int) and named.get("dir_fd") is None and _is_open(Path(path)):
            raise PermissionError(errno.EACCES, "The process cannot access the file", str(path))
        return work(path, *more, **named)

    return refuse


def _is_open(path: Path) -> bool:
    if not path.is_file():
        return False
    own = path.stat()
    for number in os.listdir("/proc/self/fd"):
        try:
            status = os.fstat(int(number))
        except OSError:
            continue
        if (status.st_dev, status.st_ino) == (own.st_dev, own.st_ino):
            return True
    return False


def _rmtree(folder: Any, ignore_errors: bool = False) -> None:
    """``shutil.rmtree`` by paths, which goes on after a file that cannot be removed, as that does."""
    for place, folders, files in os.walk(folder, topdown=False):
        for name in files:
            _tolerant(os.unlink, os.path.join(place, name), ignore_errors)
        for name in folders:
            _tolerant(os.rmdir, os.path.join(place, name), ignore_errors)
    _tolerant(os.rmdir, folder, ignore_errors)


def _tolerant(work: Callable[[Any], None], path: Any, ignore_errors: bool) -> None:
    try:
        work(path)
    except OSError:
        if not ignore_errors:
            raise


@pytest.fixture(params=["posix", "windows"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "windows":
        if not hasattr(fcntl, "F_OFD_SETLK"):
            pytest.skip("only Linux has locks of open files")
        monkeypatch.setattr(file_lock, "fcntl", None)
        monkeypatch.setattr(file_lock, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
        for name in ("replace", "rename", "unlink"):
            monkeypatch.setattr(os, name, refusing(getattr(os, name)))
        monkeypatch.setattr(Path, "unlink", lambda self, missing_ok=False: _unlink(self, missing_ok))
        monkeypatch.setattr(shutil, "rmtree", _rmtree)
    return str(request.param)


def _unlink(path: Path, missing_ok: bool) -> None:
    try:
        os.unlink(path)
    except FileNotFoundError:
        if not missing_ok:
            raise


def test_a_file_has_one_holder(tmp_path: Path, system: str) -> None:
    with locked(tmp_path / "new" / "lock", "Taken."):
        with pytest.raises(InputError, match=r"^Taken\.$"), locked(tmp_path / "new" / "lock", "Taken."):
            pass
        with locked(tmp_path / "other", "Taken."):
            pass
    with locked(tmp_path / "new" / "lock", "Taken."):
        pass


def test_what_is_locked_can_be_read_and_the_position_stays(tmp_path: Path, system: str) -> None:
    path = tmp_path / "owner"
    with path.open("w+", encoding="utf-8") as holder, path.open("r+", encoding="utf-8") as other:
        assert try_lock(holder.fileno()) is Lock.HELD
        holder.write("run.json")
        holder.flush()
        assert path.stat().st_size == len("run.json")
        assert path.read_text(encoding="utf-8") == "run.json"
        assert try_lock(other.fileno()) is Lock.BUSY
    with path.open("r+", encoding="utf-8") as other:
        assert try_lock(other.fileno()) is Lock.HELD


def test_a_file_system_without_locks_refuses_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(file_lock, "fcntl", SimpleNamespace(flock=no_locks, LOCK_EX=2, LOCK_NB=4))
    with (tmp_path / "a").open("w") as file:
        assert try_lock(file.fileno()) is Lock.UNKNOWN
    with locked(tmp_path / "lock", "Taken."), locked(tmp_path / "lock", "Taken."):
        pass
    with staged_outputs(tmp_path / "out") as stage, staged_outputs(tmp_path / "out") as other:
        for one in (stage, other):
            one.path("run.json").write_text("{}")
        assert stage.folder.exists(), "nobody can know that it is dead"
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["run.json"]


def test_of_two_runs_the_later_one_is_refused_and_nothing_is_left(tmp_path: Path, system: str) -> None:
    with staged_outputs(tmp_path) as stage:
        stage.path("run.json").write_text("{}")
        with pytest.raises(InputError, match="Another run is writing to"), staged_outputs(tmp_path):
            pass
        with staged_outputs(tmp_path, last="other.json") as other:
            other.path("other.json").write_text("{}")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["other.json", "run.json"]


def test_the_part_of_a_dead_run_is_removed(tmp_path: Path, system: str) -> None:
    dead = tmp_path / ".slopewatch-part-dead"
    dead.mkdir()
    (dead / "half.tif").write_text("half")
    (dead / OWNER).write_text("run.json")
    with part_folder(tmp_path, "run.json") as own:
        assert [p.name for p in tmp_path.iterdir()] == [own.name]
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_being_claimed_is_taken_for_a_living_one(tmp_path: Path, system: str) -> None:
    """Between making the file of its folder and filling it a run must not be taken for dead."""
    young = tmp_path / ".slopewatch-part-young"
    young.mkdir()
    (young / OWNER).touch()
    with part_folder(tmp_path, "run.json"):
        assert young.exists()


def test_of_runs_that_begin_together_exactly_one_goes_on(tmp_path: Path, system: str) -> None:
    for _ in range(5):
        start, ready, refused = threading.Barrier(3), threading.Barrier(3), []

        def begin(start=start, ready=ready, refused=refused) -> None:
            start.wait()
            try:
                with part_folder(tmp_path, "run.json"):
                    ready.wait(30)
            except InputError:
                refused.append(1)
                ready.wait(30)

        threads = [threading.Thread(target=begin) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(refused) == 2
        assert list(tmp_path.iterdir()) == []
