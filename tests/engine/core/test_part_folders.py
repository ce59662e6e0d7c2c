"""Of two runs that would write the same record in a folder one is refused; what a killed one left is removed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from slopewatch.engine.core import part_folders
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.part_folders import OWNER, PREFIX, part_folder
from slopewatch.engine.core.staged_outputs import staged_outputs

pytestmark = pytest.mark.skipif(os.name != "posix", reason="only there a lock ends with its process")
HOLD = """
import sys, time
from pathlib import Path
from slopewatch.engine.core.staged_outputs import staged_outputs
with staged_outputs(Path(sys.argv[1])) as stage:
    stage.path("a.txt").write_text("half")
    print("ready", flush=True)
    time.sleep(600)
"""


def holder(folder: Path, root: Path) -> subprocess.Popen[str]:
    """A run at work in another process."""
    program = [sys.executable, "-c", f"import runpy; runpy.run_path({str(root / 'tests' / 'conftest.py')!r})\n{HOLD}"]
    process = subprocess.Popen([*program, str(folder)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def test_a_living_run_keeps_others_out_and_a_killed_one_leaves_nothing(tmp_path: Path, root: Path) -> None:
    process = holder(tmp_path, root)
    try:
        with pytest.raises(InputError, match=r"Another run is writing to .*; wait"), staged_outputs(tmp_path):
            pass
        assert len(list(tmp_path.iterdir())) == 1, "the living run's part stays, and only that"
        with staged_outputs(tmp_path, last="other_run.json") as stage:  # commands that write single files
            stage.path("other_run.json").write_text("{}")
        assert (tmp_path / "other_run.json").is_file()
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
    assert len(list(tmp_path.glob(".slopewatch-part-*"))) == 1
    with staged_outputs(tmp_path) as stage:
        stage.path("run.json").write_text("{}")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["other_run.json", "run.json"]


def test_of_runs_that_begin_together_exactly_one_goes_on(tmp_path: Path) -> None:
    for _ in range(20):
        start, results = threading.Barrier(4), []
        ready = threading.Barrier(4)

        def begin(start=start, ready=ready, results=results) -> None:
            start.wait()
            try:
                with part_folder(tmp_path, "run.json") as folder:
                    ready.wait(10)
                    results.append(folder)
            except InputError:
                ready.wait(10)

        threads = [threading.Thread(target=begin) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(results) == 1
        shutil.rmtree(results[0], ignore_errors=True)


def test_folders_of_older_versions_are_left_until_they_are_old(tmp_path: Path) -> None:
    young, old = tmp_path / ".slopewatch-part-a", tmp_path / ".slopewatch-part-b"
    for folder in (young, old):
        folder.mkdir()
    os.utime(old, (1, 1))
    with staged_outputs(tmp_path) as stage:
        stage.path("run.json").write_text("{}")
    assert young.exists()
    assert not old.exists()


def test_the_later_run_is_refused_whatever_the_files_clock_says(tmp_path, monkeypatch) -> None:
    """The clock of files has steps; here the first file's is later, and the later folder's name sorts first."""
    names = iter((f"{PREFIX}b", f"{PREFIX}a"))

    def made(**_: object) -> str:
        folder = tmp_path / next(names)
        folder.mkdir()
        return str(folder)

    monkeypatch.setattr(part_folders.tempfile, "mkdtemp", made)
    with part_folder(tmp_path, "run.json") as first:
        os.utime(first / OWNER, (2**33, 2**33))
        with pytest.raises(InputError, match="Another run is writing"), part_folder(tmp_path, "run.json"):
            pass
