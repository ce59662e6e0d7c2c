"""Every option that takes a file refuses what is no file of its kind: at once, in one sentence, by exit code 2."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from slopewatch.tests.builders.handed_over import pit
from slopewatch.tests.builders.input_options import COMMANDS, SOUND, FileOption, file_options, unknown_texts
from slopewatch.tests.builders.program import run

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="pipes and devices of Linux")
LIMITS = {"CPU": 10, "AS": 1_000_000_000}
EVERYWHERE = {"settings", "pdal"}
"""Options that all commands get from one place."""
OPTIONS = [o for o in file_options() if o.name not in EVERYWHERE or o.command in ("ground", "batch", "check")]


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
    (folder / "run").mkdir()
    return found | {"run": pit(folder / "run")}


def bad_file(kind: str, folder: Path, ending: str) -> Path:
    """What is no file, with an ending."""
    path = folder / f"{kind}{ending}"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to({"loop": path, "device": Path("/dev/zero")}[kind])
    return path


def test_every_command_and_text_is_known():
    assert SOUND.keys() == COMMANDS.keys()
    assert not unknown_texts(), "say in tests/builders/input_options.py whether they name files"


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_no_option_opens_what_is_no_file(option: FileOption, files, tmp_path):
    # all four kinds through every option take minutes; a pipe stops whatever opens it, the others go round
    kinds = ["pipe", ("device", "folder", "loop")[OPTIONS.index(option) % 3]]
    for kind in kinds:
        path, out = bad_file(kind, tmp_path, option.ending), tmp_path / kind[:1]
        out.mkdir()
        done = run(*option.arguments(path, files, out), limits=LIMITS)
        assert done.returncode == 2, done.stderr
        assert done.stderr.count("\n") == 1
        assert str(path) in done.stderr
        assert not any(out.iterdir())
