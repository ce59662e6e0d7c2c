"""A killed run's temporary folders go with the next run, those of others stay, and a full one is named."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core import temporary_folders
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.temporary_folders import OWNER, PREFIX, VARIABLE, temporary_folder, unnamed_file
from slopewatch.tests.builders.full_disk import small_disk

__all__ = ["small_disk"]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="only there a lock ends with its process")
HOLD = """
import sys, time
from slopewatch.engine.core.temporary_folders import temporary_folder
with temporary_folder("held") as folder:
    (folder / "half.npy").write_bytes(b"half")
    print(folder, flush=True)
    time.sleep(600)
"""


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    return tmp_path


@pytest.fixture
def holder(base: Path, root: Path) -> Iterator[subprocess.Popen[str]]:
    """A run at work in another process."""
    program = f"import runpy; runpy.run_path({str(root / 'tests' / 'conftest.py')!r})\n{HOLD}"
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert Path(process.stdout.readline().strip()).parent == base
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def names(base: Path) -> list[str]:
    return sorted(path.name for path in base.iterdir())


def test_a_living_runs_folder_stays_and_a_killed_ones_goes(base: Path, holder: subprocess.Popen[str]) -> None:
    (held,) = names(base)
    with temporary_folder("own") as folder:
        assert sorted(path.name for path in (base / held).iterdir()) == [OWNER, "half.npy"]
        assert folder.stat().st_mode & 0o777 == 0o700
        assert (folder / OWNER).stat().st_mode & 0o777 == 0o600
    assert names(base) == [held]
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert names(base) == [held]
    with temporary_folder("own"):
        pass
    assert names(base) == []


def test_a_run_killed_while_it_claimed_its_folder_leaves_nothing(base: Path) -> None:
    (base / f"{PREFIX}made-a").mkdir(mode=0o700)
    (base / f"{PREFIX}claimed-b").mkdir(mode=0o700)
    (base / f"{PREFIX}claimed-b" / OWNER).touch(mode=0o600)
    with temporary_folder("own"):
        pass
    assert names(base) == []


def test_what_is_not_of_this_user_or_not_of_this_program_stays(
    base: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / OWNER).touch()
    (elsewhere / "survey.laz").write_bytes(b"data")
    (base / f"{PREFIX}link").symlink_to(elsewhere)
    for name, mode in (("open", 0o755), ("kept", 0o700)):
        folder = base / f"{PREFIX}{name}"
        folder.mkdir()
        (folder / "file").touch()
        folder.chmod(mode)
    (base / f"{PREFIX}open" / OWNER).touch()
    linked = base / f"{PREFIX}linked"
    linked.mkdir(mode=0o700)
    (linked / OWNER).symlink_to(elsewhere / OWNER)
    others = base / f"{PREFIX}others"
    if os.geteuid() == 0:
        others.mkdir(mode=0o700)
        (others / OWNER).touch()
        os.chown(others, 65534, 65534)
    (base / "slopewatch-demo").mkdir(mode=0o700)
    before = names(base)
    with temporary_folder("own"):
        pass
    assert names(base) == before
    assert names(elsewhere) == [OWNER, "survey.laz"]


def test_of_many_runs_at_once_each_keeps_its_folder(base: Path) -> None:
    """While folders are made, others look for dead ones without a pause."""
    stop, lost = threading.Event(), []

    def look() -> None:
        while not stop.is_set():
            temporary_folders.remove_dead(base)

    def make() -> None:
        for _ in range(100):
            with temporary_folder("own") as folder:
                (folder / "a").touch()
                if not (folder / OWNER).exists():
                    lost.append(folder)

    lookers = [threading.Thread(target=look) for _ in range(2)]
    makers = [threading.Thread(target=make) for _ in range(2)]
    for thread in lookers + makers:
        thread.start()
    for thread in makers:
        thread.join()
    stop.set()
    for thread in lookers:
        thread.join()
    assert lost == []
    temporary_folders.remove_dead(base)
    assert names(base) == []


def test_a_folder_that_was_taken_for_a_dead_one_is_made_again(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another run removes the first folder just before it is locked, as it may."""
    lock, seen = temporary_folders.try_lock, []

    def late(descriptor: int) -> object:
        if not seen:
            seen.append(names(base))
            for path in base.iterdir():
                (path / OWNER).unlink()
                path.rmdir()
        return lock(descriptor)

    monkeypatch.setattr(temporary_folders, "try_lock", late)
    with temporary_folder("own") as folder:
        assert (folder / OWNER).exists()
        assert [folder.name] != seen[0]


def test_the_space_is_asked_for_before_anything_is_written(base: Path) -> None:
    with (
        pytest.raises(InputError, match=rf"temporary folder '{base}' has .* MB left, and 1000000.* MB are needed; "),
        temporary_folder("own", needed_bytes=10**18),
    ):
        pytest.fail("it was made")
    assert names(base) == []


@pytest.mark.parametrize("failure", [OSError("18000 requested and 8176 written"), EngineError("the child failed")])
def test_a_failure_on_a_full_disk_names_the_folder(
    failure: Exception, base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(type(failure)), temporary_folder("own"):
        raise failure
    free = iter([10**9, 0])
    monkeypatch.setattr(temporary_folders, "_free_bytes", lambda _: next(free))
    with pytest.raises(InputError, match=rf"'{base}' failed, as its disk is full; free some"), temporary_folder("own"):
        raise failure


def test_a_full_disk_of_another_place_is_not_blamed_on_the_folder(base: Path) -> None:
    with pytest.raises(OSError, match="full") as caught, temporary_folder("own"):
        raise OSError(errno.ENOSPC, "full", "/output/zones.gpkg")
    assert caught.value.filename == "/output/zones.gpkg"
    with pytest.raises(InputError, match="as its disk is full"), temporary_folder("own") as folder:
        raise OSError(errno.ENOSPC, "full", str(folder / "points.npy"))


def test_a_disk_that_is_full_indeed(small_disk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(small_disk))
    with pytest.raises(InputError, match=rf"temporary folder '{small_disk}' failed"), temporary_folder("own") as folder:
        np.save(folder / "points.npy", np.zeros(100_000))
    with pytest.raises(InputError, match=rf"temporary folder '{small_disk}' cannot be used \(No space left"):
        unnamed_file(bytes(1_000_000))
    assert names(small_disk) == []


def test_an_unnamed_file_is_read_from_its_beginning(base: Path) -> None:
    with unnamed_file(b"pipeline") as file:
        assert names(base) == []
        assert os.read(file.fileno(), 100) == b"pipeline"


def test_the_chosen_folder_comes_before_the_variable_and_that_before_the_systems(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "abc":
        (tmp_path / name).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "c"))
    monkeypatch.setenv(VARIABLE, "")
    assert temporary_folders.base_folder() == tmp_path / "c"
    monkeypatch.setenv(VARIABLE, str(tmp_path / "b"))
    assert temporary_folders.base_folder() == tmp_path / "b"
    temporary_folders.choose(tmp_path / "a")
    with temporary_folder("own") as folder:
        assert folder.parent == tmp_path / "a"


@pytest.mark.parametrize("name", ["missing", "file"])
def test_a_chosen_folder_that_is_none_is_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=rf"temporary folder '.*{name}' does not exist; create it, or choose another"):
        temporary_folders.choose(tmp_path / name)
    monkeypatch.setenv(VARIABLE, str(tmp_path / name))
    with pytest.raises(InputError, match="does not exist"), temporary_folder("own"):
        pass
