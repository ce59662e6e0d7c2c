"""The cases of the list of bad inputs that are no clouds: days, regions, names, outputs, settings, models and programs.

What must hold is as for clouds (``test_bad_clouds``).
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from slopewatch.tests.builders import bad_inputs
from slopewatch.tests.builders.bad_inputs import SIDE, X, Y, cloud, slope
from slopewatch.tests.builders.command_bench import Bench, Case, Cases, bench, case, each
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.tests.builders.program import COMMAND
from slopewatch.tests.trust import test_bad_clouds as clouds

__all__ = ["bench"]

CASES: Cases = {}


def test_every_case_of_the_list_is_here_or_among_the_clouds() -> None:
    found = {*clouds.REFUSED, *clouds.SAID, *clouds.FEW, *clouds.PAIRS, *clouds.CASES, *CASES}
    assert found == set(range(1, 53))


@case(CASES, 33)
def days_reversed_or_equal(bench: Bench) -> None:
    other = cloud(bench.folder / "b.laz", slope(2))
    for first, second, word in (("2025-05-01", "2024-05-01", "reversed"), ("2024-05-01", "2024-05-01", "same date")):
        for command in ("inspect", "series"):
            words = (f"--epoch={first}={bench.good}", f"--epoch={second}={other}", "--output-dir", bench.out / "o")
            bench.refused(command, *words, says=(word,))
        dates = ("--epoch-from", first, "--epoch-to", second)
        bench.refused("change", bench.good, other, *dates, "--output-dir", bench.out / "o", says=(word,))


def area(bench: Bench, shape: Any, crs: object = 32651) -> Path:
    path = bench.folder / "area.gpkg"
    geopandas.GeoDataFrame(geometry=[shape], crs=32651).to_crs(crs).to_file(path)
    return path


@case(CASES, 34)
def a_region_elsewhere(bench: Bench) -> None:
    roi = area(bench, shapely.box(X + 1000, Y, X + 1010, Y + 10))
    one = ("screen", bench.good, "--output", bench.out / "s.laz", "--screening-method", "filter")
    bench.refused(*one, "--roi", roi, says=("outside",))
    bench.refused("ground", bench.good, "--output", bench.out / "g.laz", "--roi", roi, says=("outside",))
    other = cloud(bench.folder / "2025-05-01.laz", slope(2))
    bench.refused(*bench.with_bad("series", other), "--roi", roi, says=("no point",))
    bench.refused(*bench.with_bad("inspect", other), "--roi", roi, says=("outside",))


@case(CASES, 35)
@case(CASES, 36)
def a_region_that_crosses_itself_in_degrees(bench: Bench) -> None:
    """Both at once: it is repaired and brought to the clouds' system, and both is said."""
    bow = shapely.Polygon([(X, Y), (X + SIDE, Y + SIDE), (X + SIDE, Y), (X, Y + SIDE)])
    words = bench.with_bad("change", cloud(bench.folder / "2025-05-01.laz", slope(2)))
    said = bench.fine(*words, "--stable", area(bench, bow, 4326))
    assert "crosses itself" in said
    assert "transformed" in said


@case(CASES, 40)
@case(CASES, 41)
def odd_names(bench: Bench) -> None:
    for name in ('it\'s, "quoted" Böschung.laz', "a\nb \x1b[31m.laz", "[a] *?.laz", "%41 $HOME `x`;|&.laz", " -rf.laz"):
        path = bad_inputs.copied(bench.good, bench.folder / name)
        said = bench.fine("info", path)
        assert "\x1b" not in said
        bench.fine("ground", path, "--output", bench.out / f"ground of {name}")
        assert (bench.out / f"ground of {name}").is_file()
        path.write_bytes(path.read_bytes()[:700])
        bench.refused("info", path)


@case(CASES, 40)
def a_name_that_is_no_unicode(bench: Bench) -> None:
    path = Path(os.fsdecode(os.fsencode(bench.folder) + b"/2025-05-01 \xff\xfe.laz"))
    try:
        cloud(bench.folder / "b.laz", slope(2)).rename(path)
    except OSError:
        pytest.skip("this file system takes no such names")
    bench.fine("info", path)
    bench.fine("ground", path, "--output", bench.out / "g.laz")
    bench.fine(*bench.with_bad("change", path))
    bench.fine(*bench.with_bad("m3c2", path))
    path.write_bytes(b"")
    bench.refused("info", path, says=("0 bytes",))


@case(CASES, 42)
def a_template_in_the_outputs_name(bench: Bench) -> None:
    bench.fine("ground", bench.good, "--output", bench.out / "a#b.laz")
    assert (bench.out / "a#b.laz").is_file()


@case(CASES, 44)
def an_output_that_is_an_input(bench: Bench) -> None:
    other = cloud(bench.folder / "b.laz", slope(2))
    for words in (
        ("ground", bench.good, "--output", bench.good),
        ("register", bench.good, other, "--output", other),
        ("m3c2", bench.good, other, "--output", bench.good),
        ("screen", bench.good, "--output", bench.good),
    ):
        bench.refused(*words, says=("also an input",))


@case(CASES, 45)
def a_full_disk(bench: Bench) -> None:
    """No file may become larger than 4 kB, which is how a full disk ends a writer."""
    other = cloud(bench.folder / "2025-05-01.laz", slope(2))
    for command in ("ground", "register", "change", "m3c2"):
        before = sorted(bench.folder.rglob("*"))
        done = bench.run(*bench.with_bad(command, other), FSIZE=4096)
        assert done.returncode in (1, 2), (command, done.stderr)
        assert "Traceback" not in done.stderr
        assert "Internal failure" not in done.stderr, done.stderr
        assert done.stderr.strip().splitlines()[-1].startswith("Error: ")
        assert sorted(bench.folder.rglob("*")) == before, command


@case(CASES, 45)
def killed_half_way(bench: Bench) -> None:
    words = [*COMMAND, "ground", str(bench.good), "--output", str(bench.out / "g.laz"), "--progress", "json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True) as program:
        assert program.stdout is not None
        for line in program.stdout:
            if b"denois" in line or b"cloth" in line:
                break
        os.killpg(program.pid, signal.SIGKILL)
        assert program.wait(PATIENCE_S) == -signal.SIGKILL
    assert not [p for p in bench.out.iterdir() if not p.name.startswith(".")]
    bench.run("ground", bench.good, "--output", bench.out / "g.laz")
    assert (bench.out / "g.laz").is_file()


@case(CASES, 46)
def a_folder_that_cannot_be_written(bench: Bench) -> None:
    (bench.folder / "file").write_text("", encoding="utf-8")
    other = cloud(bench.folder / "b.laz", slope(2))
    began = time.monotonic()
    bench.refused("ground", bench.good, "--output", "/proc/self/g.laz", says=("cannot be written", "/proc"))
    bench.refused("change", bench.good, other, "--output-dir", bench.folder / "file" / "o", says=("file",))
    (bench.out / "g.laz").mkdir()
    bench.refused("ground", bench.good, "--output", bench.out / "g.laz", says=("is a folder",))
    assert time.monotonic() - began < PATIENCE_S


@case(CASES, 47)
def gaps_of_two_kinds(bench: Bench) -> None:
    """Half of the gaps NaN, as other programs write them: the report is the same."""
    bench.fine(*bench.with_bad("change", cloud(bench.folder / "2025-05-01.laz", slope(2))))
    report, raster = bench.out / "c" / "report.html", bench.out / "c" / "significant_change.tif"
    before = report.read_bytes()
    with rasterio.open(raster) as source:
        profile, values = source.profile, source.read()
    gaps = np.argwhere(values == -9999.0)
    assert len(gaps) > 50
    values[tuple(gaps[::2].T)] = np.nan
    with rasterio.open(raster, "w", **{**profile, "driver": "GTiff"}) as target:
        target.write(values)
    bench.fine("report", bench.out / "c")
    assert report.read_bytes() == before


@case(CASES, 48)
def malformed_parameters(bench: Bench) -> None:
    """Before any work: the clouds do not even exist."""
    epochs = ("--epoch", "2024-05-01=a.laz", "--epoch", "2025-05-01=b.laz", "--output-dir", "o")
    for words, says in (
        (("ground", "a.laz", "--output", "g.laz", "--rigidness", "7"), "rigidness"),
        (("register", "a.laz", "b.laz", "--output", "c.laz", "--maximum-offset", "nan"), "maximum_offset"),
        (("change", "a.laz", "b.laz", "--output-dir", "o", "--cell", "inf"), "cell"),
        (("m3c2", "a.laz", "b.laz", "--output", "c.laz", "--normal-scale", "-0.5"), "normal_scale"),
        (("screen", "a.laz", "--output", "s.laz", "--minimum-dip", "1e9"), "minimum_dip"),
        (("inspect", *epochs, "--cloth-resolution", "nan"), "cloth_resolution"),
        (("series", *epochs, "--cell", "-1"), "cell"),
        (("train", "a.laz", "--output-dir", "o", "--steps", "-1"), "steps"),
        (("info", "a.laz", "--height-unit", "ell"), "height-unit"),
        (("inspect", "--epoch", "0001-01-01=a.laz", "--output-dir", "o"), "0001-01-01"),
        (("inspect", "--epoch", "2024-W18=a.laz", "--output-dir", "o"), "YYYY-MM-DD"),
    ):
        done = bench.run(*words)
        assert done.returncode == 2, (words, done.stderr)
        assert says in done.stderr.strip().splitlines()[-1], done.stderr
        assert "Traceback" not in done.stderr
    assert not list(bench.out.iterdir())


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch /tmp/slopewatch-was-here",)


@case(CASES, 49)
@case(CASES, 50)
def models_that_run_or_escape(bench: Bench) -> None:
    """A pickle that would run a program, and an archive whose member leads out of its folder."""
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    import pickle

    pickled, archive = bench.folder / "model.pt", bench.folder / "model.safetensors"
    pickled.write_bytes(pickle.dumps(Evil()))
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("../escaped.txt", "x")
        file.writestr("archive/data.pkl", pickle.dumps(Evil()))
    archive.with_suffix(".json").write_text(
        json.dumps({"format": 1, "sha256": "0" * 64, "configuration": {}}), encoding="utf-8"
    )
    for path in (pickled, archive):
        words = ("screen", bench.good, "--weights", path, "--output", bench.out / "s.laz")
        assert path.name in bench.refused(*words, says=("safetensors",))
    assert not Path("/tmp/slopewatch-was-here").exists()
    assert not (bench.folder.parent / "escaped.txt").exists()


BOMB = """<?xml version="1.0"?>
<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa">
%s <!ENTITY secret SYSTEM "file:///etc/passwd">]>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>&z;&secret;</name>
<Polygon><outerBoundaryIs><LinearRing><coordinates>&z;</coordinates></LinearRing></outerBoundaryIs></Polygon>
</Placemark></Document></kml>
"""


@case(CASES, 51)
def entities_that_grow(bench: Bench) -> None:
    names = "abcdefghijklmnopqrstuvwxyz"
    entities = "".join(f'<!ENTITY {new} "{f"&{old};" * 10}">' for old, new in itertools.pairwise(names))
    roi = bench.folder / "area.kml"
    roi.write_text(BOMB % entities, encoding="utf-8")
    other = cloud(bench.folder / "2025-05-01.laz", slope(2))
    sentence = bench.refused(*bench.with_bad("change", other), "--stable", roi, says=("area.kml",))
    assert "root:" not in sentence
    one = ("screen", bench.good, "--output", bench.out / "s.laz", "--screening-method", "filter")
    bench.refused(*one, "--roi", roi, says=("area.kml",))


@case(CASES, 52)
def no_pdal(bench: Bench) -> None:
    broken = bench.folder / "pdal"
    broken.write_text("#!/bin/sh\nexit 3\n", encoding="utf-8")
    broken.chmod(0o755)
    for program in (bench.folder / "nowhere", broken):
        words = ("ground", bench.good, "--output", bench.out / "g.laz", "--pdal", program)
        bench.refused(*words, says=("pdal", "PDAL"))


@pytest.mark.parametrize(("number", "function"), each(CASES))
def test_case(bench: Bench, number: int, function: Case) -> None:
    if function.__name__ == "a_full_disk" and sys.platform != "linux":
        pytest.skip("limits the size of files as Linux does")
    function(bench)
