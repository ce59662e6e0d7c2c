"""What a cloud's file tells of the day it was flown, and surveys whose days contradict it."""

from __future__ import annotations

from datetime import date, datetime, timedelta, timezone
from pathlib import Path

import laspy
import numpy as np
import pytest
from click.testing import CliRunner
from pyproj import CRS
from slopewatch.cli.program import cli
from slopewatch.engine.core import cancellation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.dating import Evidence, check_days, days_of, evidence
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.pointcloud.pdal_program import find_pdal
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_survey
from slopewatch.tests.builders.epoch_pairs import slope

MAY24, MAY25 = date(2024, 5, 1), date(2025, 5, 1)
JUNE = (date(2024, 6, 11), date(2024, 6, 13))
TODAY = date.today()


def seconds(day: date, hour: float = 8.0) -> float:
    """Adjusted standard GPS time."""
    start = datetime(day.year, day.month, day.day, tzinfo=timezone.utc) - datetime(1980, 1, 6, tzinfo=timezone.utc)
    return start.total_seconds() + 3600 * hour - 1e9


def times(*days: date, points: int = 600) -> np.ndarray:
    return np.concatenate([seconds(day) + np.linspace(0, 1200, points // len(days)) for day in days])


def write(
    path: Path,
    *,
    gps: np.ndarray | None = None,
    standard: bool = True,
    created: date | None = TODAY,
    point_format: int = 6,
    seed: int = 1,
) -> Path:
    """A slope, with GPS times (their number is that of the points), or none in point format 0."""
    points = 600 if gps is None else len(gps)
    xyz = slope(seed, points)
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0])
    header.add_crs(CRS.from_epsg(32651))
    header.creation_date = created
    kind = laspy.header.GpsTimeType
    header.global_encoding.gps_time_type = kind.STANDARD if standard else kind.WEEK_TIME
    las = laspy.LasData(header)
    las.xyz = xyz
    las.return_number = las.number_of_returns = np.ones(points, dtype=np.uint8)
    las.classification = np.full(points, 2)
    if gps is not None:
        las.gps_time = gps
    las.write(path)
    return path


def checked(*epochs: Epoch, trusted: bool = False) -> list[str]:
    progress = Progress()
    check_days(epochs, trusted=trusted, progress=progress)
    return progress.warnings


@pytest.mark.parametrize("point_format", [1, 3, 6, 7])
@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_the_days_of_gps_times(tmp_path, point_format, ending):
    path = write(tmp_path / f"a{ending}", gps=times(MAY24), created=MAY25, point_format=point_format)
    assert evidence(path) == Evidence(flown=(MAY24, MAY24), created=MAY25)


def test_a_flight_of_several_days_strays_left_out():
    assert days_of(times(MAY24, MAY24 + timedelta(4), MAY24 + timedelta(9))) == (MAY24, MAY24 + timedelta(9))
    assert days_of(np.r_[times(MAY24), seconds(MAY25)]) == (MAY24, MAY24)


RNG = np.random.default_rng(5)
NO_TIMES = {
    "zero": np.zeros(500),
    "nan": np.full(500, np.nan),
    "infinite": np.full(500, np.inf),
    "a counter": np.arange(500.0),
    "a long counter": np.linspace(0, 2e6, 500),
    "seconds of a week": 3.1e5 + np.arange(500.0),
    "bits": RNG.integers(0, 2**63, 500).view(np.float64),
    "unadjusted": times(MAY24, points=500) + 1e9,
    "since 1970": 1.7e9 + np.arange(500.0),
    "half of it zero": np.r_[np.zeros(250), times(MAY24, points=250)],
    "next year": times(TODAY + timedelta(200), points=500),
    "negative": np.full(500, -9e8),
}


@pytest.mark.parametrize("kind", NO_TIMES)
def test_times_that_tell_nothing(tmp_path, kind):
    assert days_of(NO_TIMES[kind]) is None
    a, b = (write(tmp_path / f"{n}.laz", gps=NO_TIMES[kind], seed=n) for n in (1, 2))
    assert checked(Epoch(a, MAY24), Epoch(b, MAY25)) == []


def test_seconds_of_a_week_are_no_day_even_if_they_could_be_one(tmp_path):
    a, b = (write(tmp_path / f"{n}.laz", gps=times(d), standard=False) for n, d in ((1, MAY25), (2, MAY24)))
    assert evidence(a).flown is None
    assert checked(Epoch(a, MAY24), Epoch(b, MAY25)) == []


def test_points_without_times(tmp_path):
    a, b = (write(tmp_path / f"{n}.laz", point_format=0, seed=n) for n in (1, 2))
    assert evidence(a) == Evidence(created=TODAY)
    assert checked(Epoch(a, MAY24), Epoch(b, MAY25)) == []


@pytest.mark.parametrize("created", [None, date(2024, 1, 1)])
def test_creation_days_that_programs_leave_empty(tmp_path, created):
    path = write(tmp_path / "a.las", created=date(2024, 1, 1))
    if created is None:
        content = bytearray(path.read_bytes())
        content[90:94] = bytes(4)
        path.write_bytes(content)
    assert evidence(path).created is None
    assert checked(Epoch(path, MAY24)) == []


def swapped(tmp_path: Path) -> dict[str, tuple[Path, Path]]:
    """Pairs of which the first is the later one, by one witness each."""
    plain = {"gps": times(MAY25)}, {"gps": times(MAY24)}
    return {
        "GPS times": tuple(write(tmp_path / f"t{n}.laz", **w) for n, w in enumerate(plain)),
        "names": (write(tmp_path / "survey 2025-05-01.laz"), write(tmp_path / "survey_20240501.laz", seed=2)),
        "names, day first": (write(tmp_path / "s 30-04-2025.laz"), write(tmp_path / "s_28.04.2024.laz", seed=2)),
        "creation": (
            write(tmp_path / "c1.laz", created=MAY25 + timedelta(9)),
            write(tmp_path / "c2.laz", created=MAY24 + timedelta(9), seed=2),
        ),
        "times and a name": (write(tmp_path / "m.laz", gps=times(MAY25)), write(tmp_path / "m_20240501.laz", seed=2)),
    }


WITNESSES = ("GPS times", "names", "names, day first", "creation", "times and a name")


@pytest.mark.parametrize("witness", WITNESSES)
def test_swapped_surveys_are_refused_in_one_sentence(tmp_path, witness):
    first, second = swapped(tmp_path)[witness]
    with pytest.raises(InputError) as caught:
        checked(Epoch(first, MAY24), Epoch(second, MAY25))
    sentence = str(caught.value)
    words = ("given as 2024-05-01", "given as 2025-05-01", "reversed order", "swap the two", "--trust-dates")
    for word in (str(first), str(second), *words):
        assert word in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence
    warnings = checked(Epoch(first, MAY24), Epoch(second, MAY25), trusted=True)
    assert len(warnings) == 1
    assert "reversed order" in warnings[0]


@pytest.mark.parametrize("witness", WITNESSES)
def test_in_their_own_order_there_is_nothing_to_say(tmp_path, witness):
    first, second = swapped(tmp_path)[witness]
    assert checked(Epoch(second, MAY24), Epoch(first, MAY25)) == []


def test_surveys_without_given_days_are_compared_by_their_place(tmp_path):
    first, second = swapped(tmp_path)["GPS times"]
    with pytest.raises(
        InputError, match=r"given as the earlier one but its GPS times are of 2025-05-01.*the later one"
    ):
        checked(Epoch(first, None), Epoch(second, None))
    assert checked(Epoch(second, None), Epoch(first, None)) == []


def test_two_that_are_swapped_among_many(tmp_path):
    days = [MAY24 + timedelta(30 * n) for n in range(5)]
    flown = [days[0], None, days[3], days[2], days[4]]
    files = [write(tmp_path / f"{n}.laz", gps=None if d is None else times(d), seed=n) for n, d in enumerate(flown)]
    with pytest.raises(InputError, match=r"2\.laz' is given as 2024-06-30 .* of 2024-07-30.*3\.laz'"):
        checked(*(Epoch(f, d) for f, d in zip(files, days, strict=True)))
    files[2], files[3] = files[3], files[2]
    assert checked(*(Epoch(f, d) for f, d in zip(files, days, strict=True))) == []


@pytest.mark.parametrize(
    ("name", "made", "words"),
    [
        ("a.laz", {"gps": times(date(2024, 6, 11))}, "its GPS times are of 2024-06-11"),
        (
            "a.laz",
            {"gps": times(*JUNE)},
            "its GPS times are of 2024-06-11 to 2024-06-13",
        ),
        ("s_2023-05-01.laz", {}, "its name says 2023-05-01"),
        ("a.laz", {"created": date(2024, 4, 20)}, "its header says that it was created on 2024-04-20"),
    ],
)
def test_another_day_is_said_and_not_refused(tmp_path, name, made, words):
    path = write(tmp_path / name, **made)
    later = write(tmp_path / "b.laz", gps=times(MAY25), seed=2)
    (warning,) = checked(Epoch(path, MAY24), Epoch(later, MAY25))
    assert f"'{path}' is given as flown on 2024-05-01, but {words}" in warning
    assert (warning,) == tuple(checked(Epoch(path, MAY24)))


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("flown for some days.laz", {"gps": times(MAY24 + timedelta(3))}),
        ("another time zone.laz", {"gps": times(MAY24 - timedelta(1))}),
        ("merged.laz", {"gps": times(MAY24 - timedelta(20), MAY24 + timedelta(20))}),
        ("always the same creation day.laz", {"gps": times(MAY24), "created": date(2012, 3, 4)}),
        ("delivered 2024-07-15.laz", {"gps": times(MAY24)}),
        ("another time zone.laz", {"created": MAY24 - timedelta(1)}),
        ("created later.laz", {"created": MAY25}),
        ("tile_0652_0612_20241.laz", {}),
    ],
)
def test_what_is_no_contradiction(tmp_path, name, made):
    path = write(tmp_path / name, **made)
    assert checked(Epoch(path, MAY24)) == []


def test_a_program_that_always_writes_one_creation_day_makes_no_order(tmp_path):
    a = write(tmp_path / "a.laz", created=TODAY)
    b = write(tmp_path / "b.laz", created=date(2012, 3, 4), seed=2)
    (warning,) = checked(Epoch(a, MAY24), Epoch(b, MAY25))
    assert "b.laz" in warning


def test_surveys_of_neighbouring_days_in_their_order(tmp_path):
    a, b = (write(tmp_path / f"{n}.laz", gps=times(MAY24 + timedelta(n)), seed=n) for n in (0, 1))
    assert checked(Epoch(a, MAY24), Epoch(b, MAY24 + timedelta(1))) == []
    with pytest.raises(InputError, match="reversed"):
        checked(Epoch(b, MAY24), Epoch(a, MAY24 + timedelta(1)))


def test_simulated_surveys_tell_their_days(tmp_path):
    pair = simulate_pair(SurveyParameters(points=3000, length=10.0, height=5.0))
    paths = [tmp_path / "a.laz", tmp_path / "b.laz"]
    for path, cloud, day in zip(paths, (pair.first, pair.second), pair.dates, strict=True):
        write_survey(path, cloud, CRS.from_user_input(pair.crs), day)
    assert [evidence(path) for path in paths] == [Evidence((d, d), None, d) for d in (MAY24, MAY25)]
    assert checked(*(Epoch(p, d) for p, d in zip(paths, (MAY24, MAY25), strict=True))) == []


@pytest.mark.slow
@pytest.mark.parametrize("point_format", [1, 6])
def test_extracted_ground_tells_the_same(tmp_path, point_format):
    found = find_pdal()
    source = write(tmp_path / "a.laz", gps=times(MAY24, points=2000), created=MAY25, point_format=point_format)
    result = extract_ground(source, tmp_path / "a_ground.laz", pdal=found)
    for path in (result.clipped, result.classified, result.ground):
        assert evidence(path) == evidence(source) == Evidence(flown=(MAY24, MAY24), created=MAY25)


@pytest.fixture(autouse=True)
def _no_signals(monkeypatch) -> None:
    monkeypatch.setattr(cancellation, "install", lambda *_, **__: None)


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture
def pair(tmp_path) -> tuple[Path, Path]:
    """Ground clouds of which the first is the later one, named without days."""
    days = (("later", MAY25), ("earlier", MAY24))
    a, b = (write(tmp_path / f"{name}.laz", gps=times(d, points=3000), seed=n) for n, (name, d) in enumerate(days))
    return a, b


def arguments_of(command: str, first: Path, second: Path, folder: Path) -> list[object]:
    epochs = ["--epoch", f"2024-05-01={first}", "--epoch", f"2025-05-01={second}", "--output-dir", folder]
    days = [first, second, "--epoch-from", MAY24, "--epoch-to", MAY25]
    return {
        "inspect": ["inspect", *epochs, "--no-screen-last-epoch"],
        "series": ["series", *epochs, "--ground-ready", "--cell", 0.5],
        "change": ["change", *days, "--output-dir", folder, "--cell", 0.5],
        "m3c2": ["m3c2", *days, "--output", folder / "out.laz"],
    }[command]


@pytest.mark.parametrize("command", ["inspect", "series", "change", "m3c2"])
def test_every_command_with_days_refuses_swapped_surveys(tmp_path, pair, command):
    folder = tmp_path / "out"
    folder.mkdir()
    code, said = run(*arguments_of(command, *pair, folder))
    assert code == 2, said
    assert "reversed order" in said
    assert "--trust-dates" in said
    assert list(folder.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("command", ["change", "m3c2", "series"])
def test_trusted_days_go_on_with_a_warning(tmp_path, pair, command):
    folder = tmp_path / "out"
    folder.mkdir()
    code, said = run(*arguments_of(command, *pair, folder), "--trust-dates")
    assert code == 0, said
    record = next(p for p in folder.glob("*run.json"))
    assert "reversed order" in record.read_text()
