"""Every case of the list of bad inputs by its number, through the commands that take such a file, as a user runs them.

A command ends within limits of processor time and memory. It refuses with exit code 2 and one sentence that names file
or field, and leaves nothing behind; or it ends well and says what was odd. What results must be right is tested where
it is computed; the packages' own tests have more of each kind (tests/refusals).
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
from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
import shapely
from slopewatch.tests.builders import bad_inputs
from slopewatch.tests.builders.bad_inputs import SIDE, X, Y, bad_cloud, cloud, slope, sound
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.tests.builders.program import COMMAND, run

MEMORY_B, PROCESSOR_S = 4 << 30, 60
COARSE = ("--cell", "0.5", "--zone-profiles", "0")
COMMANDS: dict[str, tuple[str, ...]] = {
    "info": ("info", "BAD"),
    "ground": ("ground", "BAD", "--output", "OUT/g.laz"),
    "register": ("register", "GOOD", "BAD", "--output", "OUT/a.laz"),
    "change": (
        "change", "GOOD", "BAD", "--epoch-from", "2024-05-01", "--epoch-to", "2025-05-01", *COARSE,
        "--output-dir", "OUT/c",
    ),
    "m3c2": ("m3c2", "GOOD", "BAD", "--output", "OUT/m.laz"),
    "screen": ("screen", "BAD", "--screening-method", "filter", "--output", "OUT/s.laz"),
    "inspect": (
        "inspect", "--epoch", "2024-05-01=GOOD", "--epoch", "2025-05-01=BAD", "--cell", "0.5", "--output-dir", "OUT/i",
    ),
    "series": (
        "series", "--epoch", "2024-05-01=GOOD", "--epoch", "2025-05-01=BAD", "--ground-ready", "--cell", "0.5",
        "--output-dir", "OUT/s",
    ),
    "train": ("train", "BAD", "GOOD", "--output-dir", "OUT/t"),
}  # fmt: skip
NO_OTHER = ("info", "ground", "screen")
"""Commands that take one cloud."""


class Bench:
    """A folder with the sound cloud, a folder for outputs, and commands run in them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.out = folder, folder / "out"
        self.out.mkdir()
        self.good = sound(folder / "2024-05-01.laz")

    def run(self, *words: object, **limits: int) -> subprocess.CompletedProcess[str]:
        return run(*words, limits={"AS": MEMORY_B, "CPU": PROCESSOR_S, **limits})

    def with_bad(self, command: str, bad: Path) -> list[str]:
        known = {"GOOD": str(self.good), "BAD": str(bad), "OUT": str(self.out)}
        words = list(COMMANDS[command])
        for name, path in known.items():
            words = [word.replace(name, path) for word in words]
        return words

    def refused(self, *words: object, says: tuple[str, ...] = (), **limits: int) -> str:
        """The one sentence of a refusal; it holds one of ``says``, and nothing is left."""
        before = sorted(self.folder.rglob("*"))
        done = self.run(*words, **limits)
        lines = done.stderr.strip().splitlines()
        assert done.returncode == 2, (words, done.returncode, lines)
        assert "Traceback" not in done.stderr
        sentences = [line for line in lines if line.startswith("Error: ")]
        assert sentences == lines[-1:], lines
        assert sentences[0].endswith((".", "?)")), lines
        assert not says or any(word in sentences[0] for word in says), (says, sentences)
        assert sorted(self.folder.rglob("*")) == before, "something was left behind"
        return sentences[0]

    def fine(self, *words: object, says: tuple[str, ...] = ()) -> str:
        """What a command says that ends well."""
        done = self.run(*words)
        assert done.returncode == 0, (words, done.stderr)
        assert "Traceback" not in done.stderr
        said = done.stderr + done.stdout
        assert not says or any(word in said for word in says), (says, said)
        assert not list(self.out.rglob(".*"))
        return said

    def bounded(self, command: str, bad: Path) -> None:
        """Either of the two; what a command can still say of so little differs."""
        words = self.with_bad(command, bad)
        done = self.run(*words)
        assert done.returncode in (0, 2), (words, done.stderr)
        assert "Traceback" not in done.stderr
        if done.returncode == 2:
            assert done.stderr.strip().splitlines()[-1].startswith("Error: ")
            assert not list(self.out.rglob("*"))


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


REFUSED = {
    1: ("0 bytes",),
    2: ("not a LAS or LAZ file",),
    3: ("of the 4000 points",),
    4: ("cut short",),
    5: ("damaged",),
    6: ("holds 4000 of the 5000 points",),
    8: ("variable length record",),
    9: ("point format",),
    10: ("20 bytes",),
    11: ("scale",),
    12: ("scale",),
    13: ("offset",),
    15: ("scale", "coordinates"),
    20: ("no points",),
    24: ("no coordinate reference system",),
    25: ("geographic",),
}
"""Clouds that no command takes, and words of the sentence."""
SAID = {7: ("3900",), 14: ("bounding box",), 39: ("return number",), 43: ("",)}
"""Clouds that are read, with what is odd about them said."""
FEW = (21, 22, 23)
"""Too few or too alike points: what can still be said of them depends on the command."""
PAIRS = {26: ("UTM zone",), 30: ("do not overlap", "overlap"), 32: ("the same cloud",)}
"""Clouds that do not go with the other one."""

Case = Callable[[Bench], None]
OTHERS: dict[int, list[Case]] = {}


def case(number: int) -> Callable[[Case], Case]:
    """The function tests case ``number`` of the list."""

    def keep(function: Case) -> Case:
        OTHERS.setdefault(number, []).append(function)
        return function

    return keep


def test_every_case_of_the_list_is_here() -> None:
    assert {*REFUSED, *SAID, *FEW, *PAIRS, *OTHERS} == set(range(1, 53))


@pytest.mark.parametrize("command", [c for c in COMMANDS if c != "train"])
@pytest.mark.parametrize("number", REFUSED)
def test_no_command_takes_it(bench: Bench, number: int, command: str) -> None:
    bad = bad_cloud(number, bench.folder)
    if (number, command) == (20, "info") or (number in (24, 25) and command == "info"):
        bench.bounded(command, bad)
        return
    sentence = bench.refused(*bench.with_bad(command, bad), says=REFUSED[number])
    assert bad.name in sentence


@pytest.mark.parametrize("number", [1, 5, 8, 24])  # torch takes seconds to be loaded, and the reader is the same
def test_training_does_not_take_it(bench: Bench, number: int) -> None:
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    bad = bad_cloud(number, bench.folder)
    assert bad.name in bench.refused(*bench.with_bad("train", bad), says=REFUSED[number])


@pytest.mark.parametrize("command", ["info", "register", "m3c2"])
@pytest.mark.parametrize("number", SAID)
def test_it_is_read_and_said(bench: Bench, number: int, command: str) -> None:
    bench.fine(*bench.with_bad(command, bad_cloud(number, bench.folder)), says=SAID[number])


@pytest.mark.parametrize("command", [c for c in COMMANDS if c not in ("train", "inspect")])
@pytest.mark.parametrize("number", FEW)
def test_few_points_end_no_command(bench: Bench, number: int, command: str) -> None:
    bench.bounded(command, bad_cloud(number, bench.folder))


@pytest.mark.parametrize("command", [c for c in COMMANDS if c not in (*NO_OTHER, "train")])
@pytest.mark.parametrize("number", PAIRS)
def test_it_does_not_go_with_the_other_epoch(bench: Bench, number: int, command: str) -> None:
    if (number, command) == (32, "register"):
        pytest.skip("a cloud may be registered to itself: it shows that nothing moves")
    bench.refused(*bench.with_bad(command, bad_cloud(number, bench.folder)), says=PAIRS[number])


@case(16)
def beyond_32_bits(bench: Bench) -> None:
    """Coordinates so far that the file's offset does not reach them get another one."""
    transform, moved = bench.folder / "t.json", bench.out / "moved.laz"
    matrix = np.eye(4)
    matrix[:3, 3] = 2e7, -3e6, 100.0
    transform.write_text(json.dumps({"matrix": matrix.tolist()}), encoding="utf-8")
    other = cloud(bench.folder / "b.laz", slope(2))
    bench.fine("register", bench.good, other, "--apply", transform, "--output", moved)
    assert np.allclose(laspy.read(moved).xyz, laspy.read(other).xyz + matrix[:3, 3], atol=0.002)


@case(17)
@case(19)
def a_grid_beyond_the_memory(bench: Bench) -> None:
    """An outlier 900 km away makes a grid of 3e12 cells."""
    bad = bad_cloud(17, bench.folder)
    bench.refused(*bench.with_bad("change", bad), says=("cell", "outlier", "overlap", "GB"))
    bench.bounded("series", bad)  # of what both surveys cover


@case(18)
def points_far_below(bench: Bench) -> None:
    ground = bench.out / "g.laz"
    bench.fine("ground", bad_cloud(18, bench.folder), "--output", ground)
    assert laspy.read(ground).z.min() > 40


@case(27)
def feet(bench: Bench) -> None:
    bench.fine("info", cloud(bench.folder / "a.laz", slope(2), 2227), says=("foot", "feet"))


@case(28)
def other_heights(bench: Bench) -> None:
    first, second = (
        cloud(bench.folder / f"{year}-05-01.laz", slope(year), f"EPSG:32651+{system}")
        for year, system in ((2021, 5773), (2022, 3855))
    )
    bench.good = first
    for command in ("change", "m3c2", "series"):
        bench.refused(*bench.with_bad(command, second), says=("height systems",))


@case(28)
@case(29)
def all_higher_alike(bench: Bench) -> None:
    """Heights of another system that none declares, or one offset: no deformation."""
    for number, offset in ((29, 0.4), (28, 25.0)):
        bad = bad_cloud(number, bench.folder)
        words = bench.with_bad("change", bad)
        bench.fine(*words, "--overwrite", says=("datum", "height bias", "uniform"))
        record = json.loads((bench.out / "c" / "run.json").read_text(encoding="utf-8"))
        assert record["uniform_dz_m"] == pytest.approx(offset, abs=0.05)
        assert record["metrics"]["zone_count"] == 0


@case(31)
def a_tiny_overlap(bench: Bench) -> None:
    bad = bad_cloud(31, bench.folder)
    for command in ("register", "change", "m3c2"):
        bench.bounded(command, bad)
        for path in sorted(bench.out.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()


@case(33)
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


@case(34)
def a_region_elsewhere(bench: Bench) -> None:
    roi = area(bench, shapely.box(X + 1000, Y, X + 1010, Y + 10))
    one = ("screen", bench.good, "--output", bench.out / "s.laz", "--screening-method", "filter")
    bench.refused(*one, "--roi", roi, says=("outside",))
    bench.refused("ground", bench.good, "--output", bench.out / "g.laz", "--roi", roi, says=("outside",))
    other = cloud(bench.folder / "2025-05-01.laz", slope(2))
    bench.refused(*bench.with_bad("series", other), "--roi", roi, says=("no point",))
    bench.refused(*bench.with_bad("inspect", other), "--roi", roi, says=("outside",))


@case(35)
@case(36)
def a_region_that_crosses_itself_in_degrees(bench: Bench) -> None:
    """Both at once: it is repaired and brought to the clouds' system, and both is said."""
    bow = shapely.Polygon([(X, Y), (X + SIDE, Y + SIDE), (X + SIDE, Y), (X, Y + SIDE)])
    words = bench.with_bad("change", cloud(bench.folder / "2025-05-01.laz", slope(2)))
    said = bench.fine(*words, "--stable", area(bench, bow, 4326))
    assert "crosses itself" in said
    assert "transformed" in said


@case(37)
def no_ground(bench: Bench) -> None:
    """Points anywhere in the air: nothing under them is called ground without a word."""
    rng = np.random.default_rng(1)
    air = cloud(bench.folder / "a.laz", rng.uniform(0, [SIDE, SIDE, 60], (6000, 3)) + [X, Y, 0])
    done = bench.run("ground", air, "--output", bench.out / "g.laz")
    assert done.returncode in (0, 2), done.stderr
    assert "ground" in done.stderr
    assert done.returncode == 2 or "Warning" in done.stderr


@case(38)
def nothing_stable(bench: Bench) -> None:
    """Two slopes that share no surface: no registration is made up."""
    rng = np.random.default_rng(2)
    xyz = slope(2)
    xyz[:, 2] += 3 * np.sin(xyz[:, 0] * 0.8 + 1) * np.cos(xyz[:, 1] * 0.9) + rng.normal(0, 0.3, len(xyz))
    done = bench.run(*bench.with_bad("register", cloud(bench.folder / "2025-05-01.laz", xyz)))
    assert done.returncode in (0, 2), done.stderr
    assert done.returncode == 2 or "Warning" in done.stderr


@case(40)
@case(41)
def odd_names(bench: Bench) -> None:
    for name in ('it\'s, "quoted" Böschung.laz', "a\nb \x1b[31m.laz", "[a] *?.laz", "%41 $HOME `x`;|&.laz", " -rf.laz"):
        path = bad_inputs.copied(bench.good, bench.folder / name)
        said = bench.fine("info", path)
        assert "\x1b" not in said
        bench.fine("ground", path, "--output", bench.out / f"ground of {name}")
        assert (bench.out / f"ground of {name}").is_file()
        path.write_bytes(path.read_bytes()[:700])
        bench.refused("info", path)


@case(40)
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


@case(42)
def a_template_in_the_outputs_name(bench: Bench) -> None:
    bench.fine("ground", bench.good, "--output", bench.out / "a#b.laz")
    assert (bench.out / "a#b.laz").is_file()


@case(44)
def an_output_that_is_an_input(bench: Bench) -> None:
    other = cloud(bench.folder / "b.laz", slope(2))
    for words in (
        ("ground", bench.good, "--output", bench.good),
        ("register", bench.good, other, "--output", other),
        ("m3c2", bench.good, other, "--output", bench.good),
        ("screen", bench.good, "--output", bench.good),
    ):
        bench.refused(*words, says=("also an input",))


@case(45)
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


@case(45)
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


@case(46)
def a_folder_that_cannot_be_written(bench: Bench) -> None:
    (bench.folder / "file").write_text("", encoding="utf-8")
    other = cloud(bench.folder / "b.laz", slope(2))
    began = time.monotonic()
    bench.refused("ground", bench.good, "--output", "/proc/self/g.laz", says=("cannot be written", "/proc"))
    bench.refused("change", bench.good, other, "--output-dir", bench.folder / "file" / "o", says=("file",))
    (bench.out / "g.laz").mkdir()
    bench.refused("ground", bench.good, "--output", bench.out / "g.laz", says=("is a folder",))
    assert time.monotonic() - began < PATIENCE_S


@case(47)
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


@case(48)
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


@case(49)
@case(50)
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


@case(51)
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


@case(52)
def no_pdal(bench: Bench) -> None:
    broken = bench.folder / "pdal"
    broken.write_text("#!/bin/sh\nexit 3\n", encoding="utf-8")
    broken.chmod(0o755)
    for program in (bench.folder / "nowhere", broken):
        words = ("ground", bench.good, "--output", bench.out / "g.laz", "--pdal", program)
        bench.refused(*words, says=("pdal", "PDAL"))


@pytest.mark.parametrize(("number", "function"), [(n, f) for n, many in sorted(OTHERS.items()) for f in many])
def test_case(bench: Bench, number: int, function: Case) -> None:
    if function.__name__ == "a_full_disk" and sys.platform != "linux":
        pytest.skip("limits the size of files as Linux does")
    function(bench)


SAMPLES = {
    "bad_vlr_count.las": 8, "garbage_nVariableLength.las": 8, "bad-geotiff-keys.las": 24, "no-points.las": 20,
    "single_point.laz": 21, "spurious.las": 14, "gps-time-nan.las": 15, "lots_of_vlr.las": 8,
    "1.2-empty-geotiff-vlrs.las": 24,
}  # fmt: skip


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_from_public_collections(bench: Bench, shared_data: Path, name: str) -> None:
    for command in ("info", "ground", "register", "screen"):
        bench.bounded(command, shared_data / "bad_las" / name)
        for path in sorted(bench.out.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
