"""Ten of the bad inputs through the real qgis_process, by their numbers: the engine's sentence, and nothing left."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from slopewatch.tests.builders.qgis import ROOT, QgisProcess, engine_python

BUILDER = ROOT / "tests" / "builders" / "bad_inputs.py"


def bad(number: int, path: Path) -> Path:
    subprocess.run([engine_python(), BUILDER, str(number), path], check=True, capture_output=True)
    return path


CASES = {
    1: ("extractground", "0 bytes"),
    2: ("screenhazards", "not a LAS or LAZ file"),
    3: ("registerepochs", "of the 4000 points"),
    5: ("m3c2distances", "damaged"),
    8: ("elevationchange", "variable length record"),
    12: ("extractground", "scale"),
    20: ("registerepochs", "no points"),
    24: ("elevationchange", "declares no coordinate reference system"),
    26: ("m3c2distances", "UTM zone"),
    32: ("inspectslope", "the same cloud"),
}
ONE = {"extractground": "g.laz", "screenhazards": "s.laz"}
FILES = {"registerepochs": "a.laz", "m3c2distances": "m.laz"}
ENDINGS = {3: "las"}


@pytest.mark.parametrize("number", CASES)
def test_it_gets_the_engines_sentence(qgis_process: QgisProcess, tmp_path: Path, number: int) -> None:
    algorithm, words = CASES[number]
    good = bad(32, tmp_path / "2024-05-01.laz")  # of the list's case 32 this is the other one of two equal clouds
    cloud = bad(number, tmp_path / f"2025-05-01.{ENDINGS.get(number, 'laz')}")
    out = tmp_path / "out"
    out.mkdir()
    given: dict[str, object] = {"INPUT": cloud} if algorithm in ONE else {"REFERENCE": good, "CLOUD": cloud}
    if algorithm in ONE or algorithm in FILES:
        given["OUTPUT"] = out / {**ONE, **FILES}[algorithm]
    else:
        given["OUTPUT_FOLDER"] = out
    done = qgis_process.attempt(algorithm, **given)
    assert done.returncode == 1
    assert words in done.stderr, done.stderr[-2000:]
    assert "Traceback" not in done.stderr
    assert "engine crashed" not in done.stderr
    assert not list(out.iterdir()), "something was left behind"
