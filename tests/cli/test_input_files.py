"""Every option that takes a file refuses what is no file of its kind: at once, in one sentence, by exit code 2."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from slopewatch.tests.builders.input_options import SOUND, COMMANDS, FileOption, file_options, unknown_texts
from slopewatch.tests.builders.program import run

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="pipes and devices of Linux")
LIMITS = {"CPU": 10, "AS": 1_000_000_000}
OPTIONS = list(file_options())


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """Small regular files, sound as far as anything looks before the bad one is refused."""
    folder = tmp_path_factory.mktemp("sound")
    content = {
        "cloud": ("2024-05-01.laz", b"LASF"), "later": ("2025-05-01.laz", b"LASF1"),
        "model": ("2024-05-01.tif", b"II*\0"), "later_model": ("2025-05-01.tif", b"II*\0more"),
        "picture": ("top_view.tif", b"II*\0"), "area": ("area.geojson", b"{}"), "line": ("line.geojson", b"{}"),
        "plan": ("plan.gpkg", b"SQLite format 3\0"), "labels": ("labels.json", b"[]"), "tasks": ("tasks.json", b"[]"),
        "manifest": ("manifest.csv", b"slope,date,file,roi\nA,2024-05-01,2024-05-01.laz,area.geojson\n"),
    }  # fmt: skip
    found = {}
    for kind, (name, data) in content.items():
        found[kind] = folder / name
        found[kind].write_bytes(data)
    (run_folder := folder / "run").mkdir()
    return found | {"run": run_folder}


@pytest.fixture(scope="module")
def bad(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bad")
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("other")
    (folder / "other").symlink_to("loop")
    return {"pipe": folder / "pipe", "device": Path("/dev/zero"), "folder": folder / "folder", "loop": folder / "loop"}


def test_every_command_and_text_is_known():
    assert SOUND.keys() == COMMANDS.keys()
    assert not unknown_texts(), "say in tests/builders/input_options.py whether they name files"


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "loop"])
@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_no_option_opens_what_is_no_file(option: FileOption, kind: str, files, bad, tmp_path):
    done = run(*option.arguments(bad[kind], files, tmp_path), limits=LIMITS)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert str(bad[kind]) in done.stderr
    assert not any(tmp_path.iterdir())
