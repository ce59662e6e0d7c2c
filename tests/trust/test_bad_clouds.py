"""The cases of the list of bad inputs that are clouds, by their numbers, through the commands that take such a file.

A command ends within limits of processor time and memory. It refuses with exit code 2 and one sentence that names file
or field, and leaves nothing behind; or it ends well and says what was odd. What results must be right is tested where
it is computed; the packages' own tests have more of each kind (tests/refusals).
"""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.tests.builders.bad_inputs import SIDE, X, Y, bad_cloud, cloud, slope
from slopewatch.tests.builders.command_bench import COMMANDS, NO_OTHER, Bench, Case, Cases, bench, case, each

__all__ = ["bench"]

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
CASES: Cases = {}


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


@case(CASES, 16)
def beyond_32_bits(bench: Bench) -> None:
    """Coordinates so far that the file's offset does not reach them get another one."""
    transform, moved = bench.folder / "t.json", bench.out / "moved.laz"
    matrix = np.eye(4)
    matrix[:3, 3] = 2e7, -3e6, 100.0
    transform.write_text(json.dumps({"matrix": matrix.tolist()}), encoding="utf-8")
    other = cloud(bench.folder / "b.laz", slope(2))
    bench.fine("register", bench.good, other, "--apply", transform, "--output", moved)
    assert np.allclose(laspy.read(moved).xyz, laspy.read(other).xyz + matrix[:3, 3], atol=0.002)


@case(CASES, 17)
@case(CASES, 19)
def a_grid_beyond_the_memory(bench: Bench) -> None:
    """An outlier 900 km away makes a grid of 3e12 cells."""
    bad = bad_cloud(17, bench.folder)
    bench.refused(*bench.with_bad("change", bad), says=("cell", "outlier", "overlap", "GB"))
    bench.bounded("series", bad)  # of what both surveys cover


@case(CASES, 18)
def points_far_below(bench: Bench) -> None:
    ground = bench.out / "g.laz"
    bench.fine("ground", bad_cloud(18, bench.folder), "--output", ground)
    assert laspy.read(ground).z.min() > 40


@case(CASES, 27)
def feet(bench: Bench) -> None:
    bench.fine("info", cloud(bench.folder / "a.laz", slope(2), 2227), says=("foot", "feet"))


@case(CASES, 28)
def other_heights(bench: Bench) -> None:
    first, second = (
        cloud(bench.folder / f"{year}-05-01.laz", slope(year), f"EPSG:32651+{system}")
        for year, system in ((2021, 5773), (2022, 3855))
    )
    bench.good = first
    for command in ("change", "m3c2", "series"):
        bench.refused(*bench.with_bad(command, second), says=("height systems",))


@case(CASES, 28)
@case(CASES, 29)
def all_higher_alike(bench: Bench) -> None:
    """Heights of another system that none declares, or one offset: no deformation."""
    for number, offset in ((29, 0.4), (28, 25.0)):
        bad = bad_cloud(number, bench.folder)
        words = bench.with_bad("change", bad)
        bench.fine(*words, "--overwrite", says=("datum", "height bias", "uniform"))
        record = json.loads((bench.out / "c" / "run.json").read_text(encoding="utf-8"))
        assert record["uniform_dz_m"] == pytest.approx(offset, abs=0.05)
        assert record["metrics"]["zone_count"] == 0


@case(CASES, 31)
def a_tiny_overlap(bench: Bench) -> None:
    bad = bad_cloud(31, bench.folder)
    for command in ("register", "change", "m3c2"):
        bench.bounded(command, bad)
        for path in sorted(bench.out.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()


@case(CASES, 37)
def no_ground(bench: Bench) -> None:
    """Points anywhere in the air: nothing under them is called ground without a word."""
    rng = np.random.default_rng(1)
    air = cloud(bench.folder / "a.laz", rng.uniform(0, [SIDE, SIDE, 60], (6000, 3)) + [X, Y, 0])
    done = bench.run("ground", air, "--output", bench.out / "g.laz")
    assert done.returncode in (0, 2), done.stderr
    assert "ground" in done.stderr
    assert done.returncode == 2 or "Warning" in done.stderr


@case(CASES, 38)
def nothing_stable(bench: Bench) -> None:
    """Two slopes that share no surface: no registration is made up."""
    rng = np.random.default_rng(2)
    xyz = slope(2)
    xyz[:, 2] += 3 * np.sin(xyz[:, 0] * 0.8 + 1) * np.cos(xyz[:, 1] * 0.9) + rng.normal(0, 0.3, len(xyz))
    done = bench.run(*bench.with_bad("register", cloud(bench.folder / "2025-05-01.laz", xyz)))
    assert done.returncode in (0, 2), done.stderr
    assert done.returncode == 2 or "Warning" in done.stderr


@pytest.mark.parametrize(("number", "function"), each(CASES))
def test_case(bench: Bench, number: int, function: Case) -> None:
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
