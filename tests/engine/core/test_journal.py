"""A run that is killed while it replaces results leaves the earlier ones, once the next command has looked."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from slopewatch.engine.core import journal
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.file_lock import Lock
from slopewatch.engine.core.journal import JOURNAL
from slopewatch.engine.core.part_folders import PREFIX, part_folder, settle
from slopewatch.engine.core.staged_outputs import Stage, staged_outputs
from slopewatch.tests.builders.killed_runs import KILLED, killed_before_done

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="a killed run is a forked process")
Tree = dict[str, str]


def tree(*folders: Path) -> Tree:
    """All that a folder holds: the content of files, where links lead, and empty folders."""
    found = {}
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            name = f"{folder.name}/{path.relative_to(folder)}"
            if path.is_symlink():
                found[name] = f"-> {os.readlink(path)}"
            elif path.is_file():
                found[name] = path.read_text()
            elif not any(path.iterdir()):
                found[name] = "empty"
    return found


def killed_at(number: int, work: Callable[[], None], names: tuple[str, ...] = ("replace", "unlink")) -> bool:
    """Run ``work`` in a process that ends without any clean-up before its call of that number; False if it ended."""
    child = os.fork()
    if child == 0:
        calls = 0

        def counted(function: Callable[..., None]) -> Callable[..., None]:
            def call(*arguments: object, **more: object) -> None:
                nonlocal calls
                calls += 1
                if calls == number:
                    os._exit(KILLED)
                function(*arguments, **more)

            return call

        for name in names:
            setattr(os, name, counted(getattr(os, name)))
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, KILLED)
    return code == KILLED


def earlier(out: Path, other: Path) -> None:
    """Results with all that is hard to put back."""
    for name in ("run.json", "zones.gpkg", "zones.gpkg-wal", "rest.gpkg", "clouds/old.laz", "mine.txt"):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(f"old {name}")
    (out / "linked.tif").symlink_to("clouds/old.laz")
    (out / "broken.tif").symlink_to("nowhere")
    other.mkdir()
    (other / "transform.json").write_text("old")


def write_new(stage: Stage, *names: str) -> None:
    for name in names:
        stage.path(name).write_text(f"new {name}")


def replace(out: Path, other: Path) -> None:
    with staged_outputs(out, other) as stage:
        write_new(stage, "run.json", "zones.gpkg", "linked.tif", "broken.tif", "new/deep/a.tif")
        for name in ("rest.gpkg", "clouds/old.laz"):
            stage.discard(name)
        write_new(stage.beside(other), "transform.json", "more.json")


@pytest.fixture
def places(tmp_path: Path) -> tuple[Path, Path]:
    out, other = tmp_path / "out", tmp_path / "other"
    earlier(out, other)
    return out, other


def copy_back(kept: Path, places: tuple[Path, Path]) -> None:
    for place in places:
        shutil.rmtree(place)
        shutil.copytree(kept / place.name, place, symlinks=True)


def keep(tmp_path: Path, places: tuple[Path, Path], name: str) -> Path:
    for place in places:
        shutil.copytree(place, tmp_path / name / place.name, symlinks=True)
    return tmp_path / name


def half_replaced(places: tuple[Path, Path]) -> Path:
    """Killed at the moment at which only the last rename is missing; the part folder with the journal."""
    killed_before_done(lambda: replace(*places))
    (found,) = places[0].glob(f"{PREFIX}*")
    assert (found / JOURNAL).is_file()
    return found


@pytest.fixture
def no_fsync(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes most of the time, and a killed process does not need it."""
    monkeypatch.setattr(os, "fsync", lambda _: None)


@pytest.mark.usefixtures("no_fsync")
def test_after_a_kill_at_any_rename_all_is_old_or_all_is_new(tmp_path: Path, places: tuple[Path, Path]) -> None:
    kept, old = keep(tmp_path, places, "kept"), tree(*places)
    replace(*places)
    new = tree(*places)
    assert new != old
    assert "out/zones.gpkg-wal" not in new
    copy_back(kept, places)
    number, found = 1, []
    while killed_at(number, lambda: replace(*places)):
        for place in places if number % 2 else reversed(places):  # whichever folder the next command looks at first
            settle(place)
        left = tree(*places)
        assert left in (old, new), f"killed at {number}"
        found.append(left == new)
        copy_back(kept, places)
        number += 1
    assert found == sorted(found), "old until one moment, new from then on"
    assert found.count(False) > len(old) + len(new) - 2
    assert found.count(True) > 2


@pytest.mark.usefixtures("no_fsync")
def test_putting_back_can_be_killed_anywhere_and_repeated(tmp_path: Path, places: tuple[Path, Path]) -> None:
    old = tree(*places)
    half_replaced(places)
    half = keep(tmp_path, places, "half")
    number = 1
    while killed_at(number, lambda: settle(places[1])):
        for place in places:
            settle(place)
        assert tree(*places) == old, f"killed at {number}"
        number += 1
        copy_back(half, places)
    assert number > len(old), "each file was a chance to be killed"


def test_what_people_changed_after_the_kill_is_kept(places: tuple[Path, Path]) -> None:
    out, old = places[0], tree(*places)
    half_replaced(places)
    (out / "zones.gpkg").write_text("new, and reviewed by hand")
    (out / "rest.gpkg").write_text("somebody's")
    settle(out)
    left = tree(*places)
    assert left.pop("out/zones_edited.gpkg") == "new, and reviewed by hand"
    assert left.pop("out/rest_edited.gpkg") == "somebody's"
    assert left == old


def test_the_next_run_puts_back_before_it_writes(places: tuple[Path, Path]) -> None:
    out, old = places[0], tree(*places)
    half_replaced(places)
    with staged_outputs(out) as stage:
        assert tree(*places).items() >= old.items()
        stage.path("run.json").write_text("newer")
    assert tree(*places) == old | {"out/run.json": "newer"}


def test_a_folder_that_was_moved_after_the_kill_is_put_back_too(tmp_path: Path) -> None:
    out, moved = tmp_path / "out", tmp_path / "moved"
    earlier(out, tmp_path / "other")
    old = [text for _, text in sorted(tree(out).items())]
    half_replaced((out, out))
    out.rename(moved)
    settle(moved)
    assert [text for _, text in sorted(tree(moved).items())] == old


def test_nothing_is_removed_where_the_other_folder_is_gone(tmp_path: Path, places: tuple[Path, Path]) -> None:
    out, other = places
    half_replaced(places)
    out.rename(tmp_path / "elsewhere")
    settle(other)
    assert [p.read_text() for p in other.rglob(f"{journal.ASIDE}/*")] == ["old"]


HOLD = """
import os, sys, time
from pathlib import Path
from slopewatch.engine.core.staged_outputs import staged_outputs
move = os.replace
def slowly(source, target):
    move(source, target)
    if str(target).endswith("zones.gpkg"):
        print("half", flush=True)
        sys.stdin.readline()
os.replace = slowly
with staged_outputs(Path(sys.argv[1])) as stage:
    for name in ("zones.gpkg", "run.json"):
        stage.path(name).write_text("new")
"""


def test_a_living_run_is_waited_for_and_not_undone(tmp_path: Path, root: Path, monkeypatch) -> None:
    (tmp_path / "zones.gpkg").write_text("old")
    program = f"import runpy; runpy.run_path({str(root / 'tests' / 'conftest.py')!r})\n{HOLD}"
    line = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "half\n"
        monkeypatch.setattr("slopewatch.engine.core.part_folders._MAX_MOVING_S", 0.2)
        with pytest.raises(InputError, match="Another run is writing"):
            settle(tmp_path)
        assert (tmp_path / "zones.gpkg").read_text() == "new"
        monkeypatch.undo()
        process.stdin.write("\n")
        process.stdin.flush()
        settle(tmp_path)
        assert (tmp_path / "run.json").read_text() == "new"
    assert process.returncode == 0


def test_a_move_that_can_be_neither_made_nor_undone_keeps_all_for_the_next_command(tmp_path: Path, monkeypatch) -> None:
    for name in ("a.tif", "run.json"):
        (tmp_path / name).write_text("old")
    move = os.replace

    def locked(source: Path, target: Path) -> None:
        if os.path.basename(target) == "a.tif":
            raise PermissionError(13, "Permission denied")
        move(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", locked)
        with pytest.raises(InputError, match=r"a\.tif cannot be replaced"), staged_outputs(tmp_path) as stage:
            write_new(stage, "a.tif", "run.json")
        with pytest.raises(InputError, match=r"a\.tif cannot be replaced"):
            settle(tmp_path)
    settle(tmp_path)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a.tif": "old", "run.json": "old"}


def test_a_journal_moves_no_file_outside_its_folder(tmp_path: Path) -> None:
    """A folder of results may come from anyone."""
    (tmp_path / "mine.txt").write_text("mine")
    for number, name in enumerate(("../mine.txt", str(tmp_path / "mine.txt"), "link/mine.txt", "x/../../mine.txt")):
        out = tmp_path / str(number)
        part = out / f"{PREFIX}trap"
        (part / journal.ASIDE).mkdir(parents=True)
        (out / "link").symlink_to(tmp_path)
        (part / ".owner").write_text("run.json\n1")
        (part / journal.ASIDE / "0").write_text("theirs")
        stamp = "4 " + str((tmp_path / "mine.txt").stat().st_mtime_ns)
        kept = f"{part.name}/{journal.ASIDE}/0"
        for document in (
            {"aside": [[name, kept]], "placed": [], "made": [], "parts": []},
            {"aside": [], "placed": [["gone", name, stamp]], "made": [], "parts": [str(tmp_path / f"{PREFIX}x")]},
        ):
            (part / JOURNAL).write_text(json.dumps(document))
            with pytest.raises(InputError, match="leads out of the folder"):
                settle(out)
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_a_damaged_journal_is_named_and_nothing_is_removed(places: tuple[Path, Path]) -> None:
    part = half_replaced(places)
    (part / JOURNAL).write_text("{")
    before = tree(*places)
    for _ in range(2):
        with pytest.raises(InputError, match=r"its journal '.*' cannot be read .*no JSON"):
            settle(places[0])
    assert tree(*places) == before


def test_files_are_on_the_disk_before_they_are_moved(places: tuple[Path, Path], monkeypatch) -> None:
    """Against a loss of power, of which no test can be made: the order of fsync and renames is the promise."""
    events: list[tuple[str, str]] = []
    fsync, move = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        events.append(("sync", os.path.realpath(f"/proc/self/fd/{descriptor}")))
        fsync(descriptor)

    def moved(source: Path, target: Path) -> None:
        events.append(("move", f"{target}"))
        move(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", moved)
    replace(*places)
    names = [(kind, Path(path).name) for kind, path in events]
    journaled, done = names.index(("move", JOURNAL)), names.index(("move", journal.DONE))
    for name in ("zones.gpkg", "transform.json", "a.tif", "deep", "new", f"{JOURNAL}.new", journal.ELSEWHERE):
        assert ("sync", name) in names[:journaled], name
    first_aside = next(i for i, (kind, path) in enumerate(events) if kind == "move" and f"/{journal.ASIDE}/" in path)
    first_placed = names.index(("move", "transform.json"))
    assert journaled < first_aside < first_placed < done
    assert ("sync", journal.ASIDE) in names[first_aside:first_placed]
    assert ("sync", "out") in names[first_aside:first_placed]
    for name in ("out", "other", "deep", "new"):
        assert ("sync", name) in names[first_placed:done], name
    assert names[done - 1][0] == "sync"
    assert names[done + 1][0] == "sync"


def test_locks_that_a_process_gets_twice_do_not_make_it_undo_its_own_run(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("slopewatch.engine.core.part_folders.try_lock", lambda _: Lock.HELD)
    with part_folder(tmp_path, "run.json") as folder:
        settle(tmp_path)
        assert folder.is_dir()


def test_sigkill_itself(places: tuple[Path, Path]) -> None:
    """As the others, by the signal: no handler runs."""
    old = tree(*places)
    child = os.fork()
    if child == 0:
        move = os.replace

        def last(source: Path, target: Path) -> None:
            move(source, target)
            if os.path.basename(target) == "run.json":
                os.kill(os.getpid(), signal.SIGKILL)

        os.replace = last  # type: ignore[assignment]
        replace(*places)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    settle(places[0])
    assert tree(*places) == old
