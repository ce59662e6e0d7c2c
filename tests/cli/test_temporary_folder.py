"""Temporary files of a command: in the folder that was chosen, none left by a killed run, a full folder is named."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from slopewatch.engine.core.temporary_folders import PREFIX, VARIABLE
from slopewatch.tests.builders.clouds import LasFile, las_file
from slopewatch.tests.builders.full_disk import small_disk
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.tests.builders.program import COMMAND, run

__all__ = ["las_file", "small_disk"]


@pytest.fixture
def cloud(las_file: LasFile, tmp_path: Path) -> Path:
    return las_file(tmp_path / "a.las", points=20_000)


def ground(cloud: Path, *more: object) -> list[str]:
    output = cloud.with_name("ground.laz")
    return [str(word) for word in ("ground", cloud, "--output", output, "--profile", "paper", *more)]


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_killed_run_leaves_nothing_after_the_next_one(cloud: Path, tmp_path: Path) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    words = ground(cloud, "--temporary-folder", folder)
    process = subprocess.Popen([*COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + PATIENCE_S
    try:
        while not list(folder.glob(f"{PREFIX}*/*")):
            assert process.poll() is None, "it ended without a temporary folder"
            assert time.monotonic() < until
            time.sleep(0.001)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert list(folder.glob(f"{PREFIX}*")), "killed while a folder was there"
    done = run(*words)
    assert done.returncode == 0, done.stderr
    assert list(folder.rglob("*")) == []


def test_a_full_temporary_folder_is_named_in_one_sentence(cloud: Path, small_disk: Path) -> None:
    full = small_disk / "full"
    full.write_bytes(bytes(os.statvfs(small_disk).f_bavail * os.statvfs(small_disk).f_frsize))
    for environment, option in ((str(small_disk), ()), ("/nowhere", ("--temporary-folder", small_disk))):
        done = run(*ground(cloud, *option), env={**os.environ, VARIABLE: environment})
        assert done.returncode == 2, done.stderr
        (error,) = [line for line in done.stderr.splitlines() if not line.startswith("Warning: ")]
        assert error.startswith(f"Error: The temporary folder '{small_disk}' has 0.0")
        assert list(small_disk.iterdir()) == [full]
        assert not cloud.with_name("ground.laz").exists()


def test_a_temporary_folder_that_is_none_is_refused(cloud: Path) -> None:
    done = run(*ground(cloud, "--temporary-folder", "missing"))
    assert done.returncode == 2
    assert "missing' does not exist; create it, or choose another one (--temporary-folder)." in done.stderr
