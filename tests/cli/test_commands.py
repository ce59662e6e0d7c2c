"""The program as users start it: help, exit codes, sentences, JSON lines."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from slopewatch.engine.core.version import VERSION
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.clouds import write_sunk_slope
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.tests.builders.program import COMMAND, run

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def clouds(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("clouds")
    return write_sunk_slope(folder / "2024-05-01.laz"), write_sunk_slope(folder / "2025-05-01.laz", lowered=0.2)


def test_help_shows_every_parameter_with_its_unit_and_default():
    shown = " ".join(run("parameters", "ground").stdout.split())
    for specification in GroundParameters.specifications():
        assert f"--{specification.option}" in shown
    resolution = next(s for s in GroundParameters.specifications() if s.name == "cloth_resolution")
    assert f"[default: {resolution.default} m, 0.02 to 20]" in shown


@pytest.mark.parametrize(
    "command",
    [
        "inspect",
        "ground",
        "register",
        "change",
        "m3c2",
        "displacement",
        "screen",
        "batch",
        "info",
        "check",
        "simulate",
        "topview",
        "suggestroi",
        "planflight",
        "compareflight",
        "locate",
        "exportlabelstudio",
        "importlabelstudio",
        "demchange",
        "exportgis",
        "createproject",
    ],
)
def test_every_command_has_help(command):
    done = run(command, "--help")
    assert done.returncode == 0
    assert command in run("--help").stdout


@pytest.mark.parametrize(
    ("arguments", "code", "start"),
    [(("info",), 0, b""), (("info", "--height-unit", "foot"), 0, b""), ((), 2, b"Error")],
)
def test_a_reader_that_has_read_enough_ends_it_quietly(clouds, arguments, code, start):
    """As ``slopewatch info FILE | head``: standard output is closed before anything is written."""
    command = list(COMMAND)
    command += [*arguments, str(clouds[0])] if arguments else ["info", "nowhere.laz", "--progress", "json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        program.stdout.close()
        errors = program.stderr.read()
        assert program.wait(PATIENCE_S) == code
    assert errors.startswith(start)
    assert b"Internal" not in errors
    assert b"BrokenPipe" not in errors
    assert start or not errors


def test_version_is_that_of_the_plugin_and_the_package():
    done = subprocess.run([*COMMAND, "--version"], capture_output=True, text=True, check=True)
    assert VERSION in done.stdout
    assert f"version={VERSION}\n" in (ROOT / "metadata.txt").read_text()


def test_change_writes_what_it_promises(clouds, tmp_path):
    out = tmp_path / "out"
    done = run("change", *clouds, "--output-dir", out, "--cell", 0.5, "--progress", "json", "--cell-value", "plane")
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    percents = [e["percent"] for e in events if e["event"] == "progress"]
    assert percents == sorted(percents)
    assert percents[-1] == 100
    result = events[-1]
    assert result["event"] == "result"
    assert {Path(p).name for p in result["outputs"].values()} >= {
        "elevation_change.tif",
        "level_of_detection.tif",
        "significant_change.tif",
        "zones.gpkg",
        "volumes.csv",
        "heatmap.png",
        "heatmap.tif",
        "top_view.tif",
        "report.html",
        "run.json",
    }
    for path in result["outputs"].values():
        assert Path(path).stat().st_size > 0
    record = json.loads((out / "run.json").read_text())
    assert record["parameters"]["change"]["cell"] == 0.5
    assert record["metrics"] == result["metrics"]
    assert record["metrics"]["zone_count"] == 1
    assert record["metrics"]["vol_loss_m3"] == pytest.approx(0.2 * 4 * 12, rel=0.03)
    assert record["metrics"]["vol_loss_err_m3"] > 0
    with (out / "volumes.csv").open(encoding="utf-8", newline="") as file:
        lines = {(line["group"], line["quantity"]): line for line in csv.DictReader(file)}
    (lost,) = (row for (group, name), row in lines.items() if "ZONES" in group and name.endswith("Lowering"))
    assert float(lost["thresholded"]) == pytest.approx(record["metrics"]["vol_loss_m3"], abs=1e-6)
    assert len(record["volumes"]["rows"]) == len(lines)
    table = geopandas.read_file(out / "zones.gpkg", layer="volumes")
    assert table["quantity"].tolist() == [name for _, name in lines]
    outlines = geopandas.read_file(out / "zones.gpkg", layer="footprints")
    assert outlines.geometry[0].covers(geopandas.read_file(out / "zones.gpkg", layer="zones").geometry[0])
    assert len(record["inputs"][0]["sha256"]) == 64
    assert not [p for p in out.iterdir() if p.name.startswith(".")]


def test_same_input_gives_the_same_bytes(clouds, tmp_path):
    for name in ("a", "b"):
        assert run("change", *clouds, "--output-dir", tmp_path / name, "--cell", 0.5).returncode == 0
    for name in (
        "elevation_change.tif",
        "level_of_detection.tif",
        "significant_change.tif",
        "heatmap.tif",
        "zones.gpkg",
        "volumes.csv",
    ):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_register_writes_the_cloud_and_a_transform_that_can_be_inverted(clouds, tmp_path):
    first, _ = clouds
    moved, transform, back = tmp_path / "moved.laz", tmp_path / "t.json", tmp_path / "back.laz"
    given = {"matrix": [[1, 0, 0, 0.3], [0, 1, 0, -0.2], [0, 0, 1, 0.1], [0, 0, 0, 1]]}
    (tmp_path / "given.json").write_text(json.dumps(given))
    other = shutil.copy(first, tmp_path / "other.laz")
    assert run("register", first, other, "--output", moved, "--apply", tmp_path / "given.json").returncode == 0
    done = run("register", first, moved, "--output", back, "--apply", tmp_path / "given.json", "--invert")
    assert done.returncode == 0, done.stderr
    source, shifted, returned = (laspy.read(p).xyz for p in (first, moved, back))
    assert np.abs(shifted - source - [0.3, -0.2, 0.1]).max() < 0.0011
    assert np.abs(returned - source).max() < 0.0021
    done = run("register", first, moved, "--output", tmp_path / "r.laz", "--transform", transform)
    assert done.returncode == 0, done.stderr
    assert np.array(json.loads(transform.read_text())["matrix"]).shape == (4, 4)


def test_change_takes_the_registrations_error_from_its_transform(clouds, tmp_path):
    first, second = clouds
    transform = tmp_path / "t.json"
    done = run("register", first, second, "--output", tmp_path / "r.laz", "--transform", transform)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "r_run.json").read_text())
    assert record["command"] == "register"
    assert record["transform"] == json.loads(transform.read_text())["matrix"]
    assert set(record["outputs"].values()) == {"r.laz", "r_run.json", "t.json"}
    found = json.loads(transform.read_text())["registration"]["registration_error_m"]
    assert found > 0
    for name, given, error, warned in (
        ("known", ["--transform", transform], found, False),
        ("given", ["--transform", transform, "--registration-error", 0.05], 0.05, False),
        ("unknown", [], 0.0, True),
    ):
        out = tmp_path / name
        assert run("change", first, second, "--output-dir", out, "--cell", 0.5, *given).returncode == 0
        changed = json.loads((out / "run.json").read_text())
        assert changed["metrics"]["registration_error_m"] == pytest.approx(error)
        assert any("registration's error is not known" in w for w in changed["warnings"]) == warned


@pytest.mark.parametrize("arguments", [["inspect", "--nope"], ["inspect"], ["nope"], ["ground", "--rigidness", "x"]])
def test_options_that_are_not_understood_are_reported_as_json_too(arguments):
    done = run(*arguments, "--progress", "json")
    assert done.returncode == 2
    event = json.loads(done.stdout)
    assert (event["event"], event["code"]) == ("error", 2)
    assert event["message"] in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_while_the_program_still_loads_is_a_cancel_too(name):
    loading = (
        "import os, signal, sys, types\n"
        "from slopewatch import cli\n"
        "late = types.ModuleType('program')\n"
        f"late.__getattr__ = lambda _: os.kill(os.getpid(), signal.{name})\n"
        "sys.modules['slopewatch.cli.program'] = late\n"
        "cli.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", loading], capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (130, "Cancelled.\n")


def test_circles_are_looked_for_seldom():
    asking = (
        "import gc, sys\n"
        "from slopewatch import cli\n"
        "sys.argv[1:] = ['--version']\n"
        "try:\n    cli.main()\n"
        "except SystemExit:\n    sys.exit(gc.get_threshold()[0] < 50_000)\n"
    )
    assert subprocess.run([sys.executable, "-c", asking], capture_output=True, cwd=ROOT).returncode == 0


def test_whole_numbers_are_no_yes_or_no_in_the_help():
    shown = " ".join(run("parameters", "ground").stdout.split())
    assert "[default: 1, 1 to 3]" in shown
    assert "[default: yes]" in shown


def test_the_zones_level_is_at_95_percent_whatever_confidence_decides(clouds, tmp_path):
    out = tmp_path / "out"
    assert run("change", *clouds, "--output-dir", out, "--cell", 0.5, "--confidence", 0.8).returncode == 0
    zone = geopandas.read_file(out / "zones.gpkg", layer="zones").iloc[0]
    with rasterio.open(out / "level_of_detection.tif") as raster:
        at_80 = np.median(raster.read(1, masked=True).compressed())
    assert zone["lod95_m"] / at_80 == pytest.approx(1.960 / 1.2816, rel=0.05)


@pytest.fixture(scope="module")
def files(tmp_path_factory, clouds) -> dict[str, Path]:
    """Clouds with one fault each, by the names that BAD has for them; ``faulty`` is their folder."""
    folder = tmp_path_factory.mktemp("faulty")
    first, second = clouds
    made = {"faulty": folder, "first": first, "second": second, "text": folder / "text.laz"}
    made["text"].write_text("not a cloud")
    laspy.read(first).write(folder / "whole.las")
    made["truncated"] = folder / "truncated.las"
    made["truncated"].write_bytes((folder / "whole.las").read_bytes()[:100_000])
    made["nocrs"] = write_sunk_slope(folder / "nocrs.laz", crs=None)
    made["geographic"] = write_sunk_slope(folder / "geographic.laz", crs=4326)
    made["elsewhere"] = write_sunk_slope(folder / "elsewhere.laz", x=5000)
    made["other_crs"] = write_sunk_slope(folder / "other_crs.laz", crs=32650)
    made["copy"] = Path(shutil.copy(first, folder / "2026-01-01.laz"))
    return made


# The command line, and words of the sentence. {out} does not exist, {new} is an empty folder.
BAD = {
    "missing": ("change {faulty}/none.laz {second} --output-dir {out}", "none.laz"),
    "not a cloud": ("change {text} {second} --output-dir {out}", "text.laz"),
    "truncated": ("change {truncated} {second} --output-dir {out}", "truncated.las"),
    "extracted ground": (
        "inspect --epoch 2024-05-01={faulty}/none.laz --ground extract --screen-last-epoch --output-dir {out}",
        "none.laz",
    ),
    "no crs": ("change {nocrs} {second} --output-dir {out}", "--crs"),
    "geographic": ("change {geographic} {second} --output-dir {out}", "geographic"),
    "no overlap": ("change {first} {elsewhere} --output-dir {out}", "do not overlap"),
    "other crs": ("change {first} {other_crs} --output-dir {out}", "different reference systems"),
    "same file": ("change {first} {first} --output-dir {out}", "same"),
    "same content": ("change {first} {copy} --output-dir {out}", "same cloud"),
    "reversed": ("change {second} {first} --output-dir {out}", "reversed"),
    "bad date": ("change {first} {second} --epoch-from yesterday --output-dir {out}", "YYYY-MM-DD"),
    "bad number": ("change {first} {second} --cell -1 --output-dir {out}", "cell is -1.0"),
    "nan": ("change {first} {second} --cell nan --output-dir {out}", "cell is nan"),
    "grid too large": ("change {first} {second} --cell 0.005 --memory-limit 0.05 --output-dir {out}", "at least"),
    "one epoch, not screened": (
        "inspect --epoch 2024-05-01={first} --no-screen-last-epoch --output-dir {out}",
        "two epochs",
    ),
    "an epoch without a date": ("inspect --epoch {text} --output-dir {out}", "text.laz' holds no date"),
    "three epochs": (
        "inspect --epoch=2020-05-01={first} --epoch=2021-05-01={first} --epoch=2022-05-01={first} --output-dir {out}",
        "--epoch was given 3 times",
    ),
    "screening of an epoch by weights that are not there": (
        "inspect --epoch=2024-05-01={first} --epoch=2025-05-01={second} --output-dir {out} --weights {new}/mine.torch",
        "mine.torch",
    ),
    "no pdal": ("ground {first} --output {new}/g.laz --pdal {new}/nopdal", "nopdal"),
    "no roi": ("ground {first} --output {new}/g.laz --roi {new}/no.gpkg", "no.gpkg"),
    "output is input": ("register {first} {second} --output {second}", "also an input"),
    "no folder": ("register {first} {second} --output {new}/no/a.laz", "does not exist"),
    "bad transform": ("register {first} {second} --output {new}/a.laz --apply {text}", "text.laz"),
    "output is no cloud": ("register {first} {second} --output {new}/a.tif", ".laz or .las"),
    "one output twice": ("register {first} {second} --output {new}/a.laz --transform {new}/a.laz", "Two outputs"),
    "inspect without roi": (
        "inspect --epoch=2024-05-01={first} --epoch=2025-05-01={second} --roi {new}/no.shp --output-dir {out}",
        "no.shp' does not exist",
    ),
    "inspect in two systems": (
        "inspect --epoch=2024-05-01={first} --epoch=2025-05-01={other_crs} --output-dir {out}",
        "other_crs.laz in WGS 84 / UTM zone 50N",
    ),
    "output under a file": ("change {first} {second} --output-dir {text}/out", "cannot be written"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_sentence_with_exit_code_2(name, files, tmp_path):
    line, words = BAD[name]
    arguments = [word.format(**files, new=tmp_path, out=tmp_path / "out") for word in line.split()]
    before = sorted(files["faulty"].rglob("*"))
    done = run(*arguments)
    assert done.returncode == 2, done.stderr
    sentence = done.stderr.strip()
    assert sentence.startswith("Error: ")
    assert "\n" not in sentence
    assert sentence.endswith(".")
    assert words in sentence
    as_json = run(*arguments, "--progress", "json")
    event = json.loads(as_json.stdout.splitlines()[-1])
    assert event == {"event": "error", "message": sentence.removeprefix("Error: "), "code": 2}
    assert sorted(files["faulty"].rglob("*")) == before, "something was left behind"
    assert list(tmp_path.iterdir()) == [], "something was left behind"
