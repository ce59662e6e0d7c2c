"""A corridor of two slopes through the real engine: killed and gone on with, in each executor, with a new survey."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_result import RunResult
from slopewatch.interface.parameters import BatchParameters
from slopewatch.interface.protocol import DONE, INPUT_REFUSED, SOME_FAILED
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.tests.builders.program import COMMAND
from slopewatch.tests.builders.series_clouds import plane
from slopewatch.tests.builders.zone_layers import opened
from slopewatch.workflows.batch.corridor import run_batch
from slopewatch.workflows.batch.corridor_plan import Given
from slopewatch.workflows.batch.planning import Common
from slopewatch.workflows.layer_files import LayerFiles

WEST, SOUTH = 500_000.0, 3_500_000.0
FAR = 40.0  # metres from the first slope to the second
OPTIONS = {"ground_ready": True, "method": "none", "cell": 0.5, "rasters_each_survey": True}
LINE = [(WEST - 100, SOUTH - 10), (WEST + 200, SOUTH - 10)]


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Slope A with three surveys, B with two; a square of 3 m rises in A. C is cut short, D is no file."""
    folder = tmp_path_factory.mktemp("corridor")
    for number in range(4):
        plane(folder / f"a{number}.laz", bump=0.15 * number, seed=number)
    for number in range(2):
        plane(folder / f"b{number}.laz", x=FAR, seed=10 + number)
    (folder / "c.laz").write_bytes((folder / "a0.laz").read_bytes()[:20_000])
    geopandas.GeoDataFrame(geometry=[shapely.LineString(LINE)], crs=32651).to_file(folder / "road.gpkg")
    write_manifest(folder, 3)
    return folder


def write_manifest(folder: Path, surveys: int) -> Path:
    lines = ["slope,date,file,roi"]
    lines += [f"<b>A,2024-0{n + 1}-01,a{n}.laz," for n in range(surveys)]
    lines += [f"B,2024-0{n + 1}-01,b{n}.laz," for n in range(2)]
    lines += ["C,2024-01-01,c.laz,", "C,2024-02-01,a1.laz,", "=D(),2024-01-01,d.laz,"]
    (folder / "corridor.csv").write_text("\n".join(lines) + "\n")
    return folder / "corridor.csv"


def batch(folder: Path, out: Path, progress: Progress | None = None, **parameters: Any) -> RunResult:
    layers = LayerFiles(folder / "road.gpkg")
    common = Common(OPTIONS, "default", None, None, BatchParameters(two_surveys="series", **parameters), layers)
    return run_batch(Given(folder / "corridor.csv", out), common, progress)


def states(out: Path) -> dict[str, dict[str, Any]]:
    lines = (out / "slopes.jsonl").read_text().splitlines()
    return {state["slope"]: state for state in map(json.loads, filter(None, lines))}


def results(out: Path) -> dict[str, bytes]:
    """All results but what holds the moment or the seconds of a run."""
    wanted = (".tif", ".gpkg", ".csv", ".png", ".vpc", ".vrt", ".html", ".parquet")
    files = [p for p in out.rglob("*") if p.suffix in wanted and p.name != "report.html"]
    return {str(p.relative_to(out)): p.read_bytes() for p in files}


def at_work(out: Path) -> list[int]:
    """Processes that work on slopes of the folder, by the system's own list."""
    found = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if f"--output-dir={out}/".encode() in place.read_bytes():
                found.append(int(place.parent.name))
        except OSError:
            continue
    return found


@pytest.fixture(scope="module")
def finished(corridor: Path) -> tuple[Path, RunResult, Progress]:
    """A batch that was killed as soon as it had begun, and then gone on with."""
    out = corridor / "out"
    arguments = ["batch", corridor / "corridor.csv", "--output-dir", out, "--centreline", corridor / "road.gpkg"]
    arguments += ["--two-surveys=series", "--ground-ready", "--method=none", "--cell=0.5", "--rasters-each-survey"]
    with subprocess.Popen([*COMMAND, *map(str, arguments)], stderr=subprocess.DEVNULL) as program:
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until and "running" not in [
            s["state"] for s in (states(out) if (out / "slopes.jsonl").exists() else {}).values()
        ]:
            time.sleep(0.05)
        while time.monotonic() < until and not at_work(out):
            time.sleep(0.05)
        program.send_signal(signal.SIGKILL)
    while time.monotonic() < until and at_work(out):
        time.sleep(0.05)
    assert not at_work(out), "a slope's process outlived the batch"
    assert {s["state"] for s in states(out).values()} >= {"running"}
    assert not (out / "run.json").exists()
    progress = Progress()
    return out, batch(corridor, out, progress, workers=2), progress


def test_a_killed_batch_goes_on_and_failures_are_rows(finished: tuple[Path, RunResult, Progress]) -> None:
    out, done, progress = finished
    figures = done.figures
    assert (figures["slopes"], figures["slopes_done"], figures["slopes_failed"]) == (4, 2, 2)
    assert {n: s["state"] for n, s in states(out).items()} == {"<b>A": "done", "B": "done", "C": "failed"}
    record = json.loads((out / "run.json").read_text())
    failed = {row["slope"]: row["sentence"] for row in record["failed"]}
    assert "c.laz" in failed["C"]
    assert "d.laz' does not exist" in failed["=D()"]
    assert all(f"{slope}: {sentence}" in progress.warnings for slope, sentence in failed.items())
    assert all(path.is_file() for path in done.outputs.values())
    assert not list(out.rglob(".slopewatch-part-*"))


def test_zones_have_their_place_along_the_road(finished: tuple[Path, RunResult, Progress]) -> None:
    zones = pyogrio.read_dataframe(finished[0] / "corridor.gpkg", layer="zones")
    (zone,) = zones[zones["slope"] == "<b>A"].to_dict("records")
    # a square of 3 m in the middle of the slope, seen in cells of 0.5 m; the road begins 100 m west of it
    assert zone["chain_from"] == pytest.approx(103.5, abs=0.51)
    assert zone["chain_to"] == pytest.approx(106.5, abs=0.51)
    assert zone["offset_m"] == pytest.approx(13.5, abs=0.51)
    assert (zone["side"], zone["source"], zone["kind"]) == ("left", "series", "uplift")
    assert zone["location"] in ("K0+103 to K0+106", "K0+104 to K0+106", "K0+104 to K0+107", "K0+103 to K0+107")
    assert zone["slope_review"] == "", "what was computed is no entry"
    own = pyogrio.read_dataframe(next(finished[0].glob("slopes/*A*/series")) / "series.gpkg", layer="zones")
    assert own["location"].tolist() == [zone["location"]]
    assert zone["location"] in (finished[0] / "corridor.html").read_text(encoding="utf-8")
    assert zone["attention"] == zone["alert_level"] > 0
    assert zone["zone_id"].startswith("<b>A/series/")


def test_the_mosaic_holds_every_slopes_change(finished: tuple[Path, RunResult, Progress]) -> None:
    out = finished[0]
    rasters = sorted(out.glob("slopes/*/series/cumulative/elevation_change_2024-01-01_*.tif"))
    last = [p for p in rasters if "2024-03-01" in p.name or p.parents[2].name == "B"]
    assert len(last) == 2
    with rasterio.open(out / "elevation_change.vrt") as whole:
        seen = whole.read(1)
        assert whole.nodata == -9999
        for path in last:
            with rasterio.open(path) as part:
                own = part.read(1)
                row, column = whole.index(*part.xy(0, 0))
                assert np.array_equal(seen[row : row + own.shape[0], column : column + own.shape[1]], own)
                assert (own != -9999).sum() > 300
                seen[row : row + own.shape[0], column : column + own.shape[1]] = -9999
    assert (seen == -9999).all(), "nothing else is in it"


def test_text_from_the_manifest_is_no_markup(finished: tuple[Path, RunResult, Progress]) -> None:
    page = (finished[0] / "corridor.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;A" in page
    assert "<b>" not in page
    assert "<script" not in page
    assert page.index("&lt;b&gt;A</a>") < page.index(">B</a>"), "what has an alert stands first"
    for target in [part.split('"')[0] for part in page.split('href="')[1:]]:
        assert target.startswith("#") or (finished[0] / target).is_file()


def test_a_finished_batch_computes_nothing(finished: tuple[Path, RunResult, Progress], corridor: Path) -> None:
    out, done, _ = finished
    before = {
        p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file() and p.name not in ("slopes.jsonl", ".lock")
    }
    started = time.process_time()
    # C is tried again by default, but its header does not even let it start
    again = batch(corridor, out, workers=2)
    assert time.process_time() - started < 5
    assert again.figures["slopes_computed"] == 0
    assert again.outputs == done.outputs
    after = {p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file() and p.name not in ("slopes.jsonl", ".lock")}
    assert after == before


@pytest.mark.filterwarnings("default")  # those of Dask are its own
@pytest.mark.parametrize(
    "how",
    [{"workers": 0}, {"workers": 4}, {"workers": 2, "scheduler": "local"}, {"scheduler": "cluster.json"}],
    ids=["own process", "4 processes", "Dask", "dask-jobqueue"],
)
def test_every_executor_gives_the_same_bytes(
    how: dict[str, Any], finished: tuple[Path, RunResult, Progress], corridor: Path, tmp_path: Path
) -> None:
    if "scheduler" in how:
        pytest.importorskip("dask_jobqueue", reason="Dask is not installed; install slopewatch[cluster]")
    if how.get("scheduler") == "cluster.json":
        options = {"cores": 1, "processes": 1, "memory": "2GB", "local_directory": str(tmp_path)}
        path = tmp_path / "cluster.json"
        path.write_text(json.dumps({"cluster": "local", "jobs": 2, "options": options}))
        how = {"scheduler": str(path)}
    batch(corridor, tmp_path / "out", **how)
    expected, found = results(finished[0]), results(tmp_path / "out")
    assert len(found) > 20
    assert found.keys() == expected.keys()
    assert [name for name in found if found[name] != expected[name]] == []


def test_a_new_survey_computes_its_slope_only_and_keeps_what_people_entered(
    finished: tuple[Path, RunResult, Progress], corridor: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    subprocess.run(["cp", "-a", str(finished[0]), str(out)], check=True)
    with opened(out / "corridor.gpkg") as database:
        database.execute("UPDATE alerts SET state = 'acknowledged', state_reason = 'seen', reviewer = 'A. Sato'")
        database.execute("UPDATE zones SET review_status = 'confirmed', slope_id = 'S 12' WHERE slope = '<b>A'")
        with pytest.raises(sqlite3.IntegrityError, match="come from the centreline"):
            database.execute("UPDATE zones SET chain_from = 12.5 WHERE slope = '<b>A'")
        with pytest.raises(sqlite3.IntegrityError, match="cannot be edited"):
            database.execute("UPDATE alerts SET attention = 0")
    changed = write_manifest(corridor, 4)
    try:
        done = batch(corridor, out, workers=1)
    finally:
        write_manifest(corridor, 3)
    assert changed.is_file()
    assert done.figures["slopes_computed"] == 1
    assert done.figures["slopes_done"] == 2
    series = json.loads(next(out.glob("slopes/*A*/series/run.json")).read_text())
    surveys = next(stage for stage in series["stages"] if stage["stage"] == "surveys")["epochs"]
    assert len(surveys) == 4
    assert [day for day, facts in surveys.items() if facts["made"]] == ["2024-04-01"]
    zones = pyogrio.read_dataframe(out / "corridor.gpkg", layer="zones")
    (zone,) = zones[zones["slope"] == "<b>A"].to_dict("records")
    assert (zone["review_status"], zone["slope_id"], zone["epoch_to"]) == ("confirmed", "S 12", "2024-04-01")
    alerts = pyogrio.read_dataframe(out / "corridor.gpkg", layer="alerts")
    first = alerts[alerts["raised_on"] == "2024-03-01"].iloc[0]
    assert (first["reviewer"], first["state"] in ("acknowledged", "closed")) == ("A. Sato", True)
    assert first["state_reason"].startswith("seen")


def test_the_page_shows_what_people_entered_without_any_slope_computed(
    finished: tuple[Path, RunResult, Progress], corridor: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    subprocess.run(["cp", "-a", str(finished[0]), str(out)], check=True)
    assert ">alert raised<" in (out / "corridor.html").read_text(encoding="utf-8")
    with opened(out / "corridor.gpkg") as database:
        database.execute("UPDATE alerts SET state = 'acknowledged', reviewer = '<i>Sato'")
    done = batch(corridor, out)
    page = (out / "corridor.html").read_text(encoding="utf-8")
    assert done.figures["slopes_computed"] == 0
    assert ">acknowledged<" in page
    assert "&lt;i&gt;Sato" in page
    (row,) = pyogrio.read_dataframe(out / "corridor.gpkg", layer="alerts").to_dict("records")
    assert (row["state"], row["reviewer"]) == ("acknowledged", "<i>Sato")
    assert not (out / "reviews_not_carried.gpkg").exists()


def test_settings_make_other_tasks_and_failed_slopes_can_wait(
    finished: tuple[Path, RunResult, Progress], corridor: Path
) -> None:
    from slopewatch.workflows.batch.estimate import memory_needs
    from slopewatch.workflows.batch.manifest import read_manifest
    from slopewatch.workflows.batch.planning import plan
    from slopewatch.workflows.batch.state import StateFile
    from slopewatch.workflows.batch.task_ids import FileHashes

    out = finished[0]
    slopes = read_manifest(corridor / "corridor.csv", out / "regions").slopes
    entries = StateFile(out / "slopes.jsonl").entries
    parameters = BatchParameters(two_surveys="series", retry_failed=False)
    common = Common(OPTIONS, "default", None, None, parameters, LayerFiles(corridor / "road.gpkg"))

    def planned(given: Common) -> Any:
        return plan(slopes, out, given, FileHashes(out / "hashes.json"), entries, Progress())

    same = planned(common)
    assert (set(same.done), same.waiting) == ({"<b>A", "B"}, [])
    assert [p.slope for p in same.problems] == ["C"]
    other = planned(replace(common, options={**OPTIONS, "cell": 0.4}))
    assert [slope.name for slope in other.waiting] == ["<b>A", "B", "C"]
    needs = memory_needs(other, Progress())
    assert set(needs) == {"<b>A", "B"}
    assert [p.slope for p in other.problems] == ["C"], "its cloud cannot be read"
    assert all(other.jobs[name].task != same.jobs[name].task for name in other.jobs)
    assert all(need > 450_000_000 for need in needs.values())
    pair = planned(replace(common, parameters=BatchParameters(two_surveys="inspect")))
    assert set(memory_needs(pair, Progress())) == {"B"}, "a series of three stays one"


LIBRARIES = ("geopandas", "laspy", "matplotlib", "pandas", "pyogrio", "pyproj", "rasterio", "scipy", "shapely")
LOOK_AGAIN = f"""
import sys
from slopewatch.cli.program import cli
try:
    cli(sys.argv[1:])
except SystemExit as end:
    print(sorted(set({LIBRARIES}) & set(sys.modules)), end.code)
"""


def test_that_nothing_is_to_be_done_is_found_without_the_libraries_of_clouds(
    finished: tuple[Path, RunResult, Progress], corridor: Path
) -> None:
    """They take ten times as long to load as a corridor of hundreds of slopes to look at."""
    out = finished[0]
    before = {name: (out / name).stat().st_mtime_ns for name in ("corridor.gpkg", "corridor.html", "run.json")}
    words = ["batch", corridor / "corridor.csv", "--output-dir", out, "--centreline", corridor / "road.gpkg"]
    words += ["--two-surveys=series", "--ground-ready", "--method=none", "--cell=0.5", "--rasters-each-survey"]
    done = subprocess.run(
        [sys.executable, "-c", LOOK_AGAIN, *map(str, words), "--no-retry-failed"],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1:] == [f"[] {SOME_FAILED}"], done.stderr
    assert "Nothing has changed" in done.stderr
    assert {name: (out / name).stat().st_mtime_ns for name in before} == before


def test_the_exit_code_says_how_many_slopes_of_a_relative_folder_have_results(
    corridor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from slopewatch.tests.builders.program import run

    slopes = tmp_path / "slopes"
    region = geopandas.GeoDataFrame(geometry=[shapely.box(WEST, SOUTH, WEST + 30, SOUTH + 30)], crs=32651)
    for name, clouds in (("B", ("b0.laz", "b1.laz")), ("C", ("c.laz", "b1.laz"))):
        (slopes / name).mkdir(parents=True)
        for month, cloud in enumerate(clouds, 1):
            (slopes / name / f"2024-0{month}-01.laz").write_bytes((corridor / cloud).read_bytes())
    region.translate(FAR).to_file(slopes / "B" / "roi.gpkg")
    monkeypatch.chdir(tmp_path)
    words = ["batch", "slopes", "--ground-ready", "--method=none", "--cell=0.5", "--no-displacement", "--workers=0"]
    words.append("--no-screen-last-epoch")

    some = run(*words, "--output-dir=out")
    assert some.returncode == SOME_FAILED, some.stderr
    assert states(Path("out"))["B"]["state"] == "done"
    assert "1 slope failed" in some.stdout

    (slopes / "B").rename("B")
    none = run(*words, "--output-dir=none")
    assert none.returncode == INPUT_REFUSED
    assert none.stderr.splitlines()[-1].startswith("Error: No slope has results; correct the manifest or the surveys (")
    assert none.stdout == ""
    assert Path("none/corridor.html").is_file()

    (slopes / "C").rename("C")
    empty = run(*words, "--output-dir=empty")
    assert (empty.returncode, Path("empty").exists()) == (INPUT_REFUSED, False)
    Path("B").rename(slopes / "B")
    assert run(*words, "--output-dir=out").returncode == DONE


def test_other_results_are_refused_and_two_batches_do_not_share_a_folder(corridor: Path, tmp_path: Path) -> None:
    from slopewatch.engine.core.file_lock import locked

    (tmp_path / "run.json").write_text('{"command": "inspect"}')
    with pytest.raises(InputError, match="holds results already"):
        batch(corridor, tmp_path)
    with locked(tmp_path / "other" / ".lock", ""), pytest.raises(InputError, match="Another batch is at work in"):
        batch(corridor, tmp_path / "other")
    (tmp_path / "slopes").mkdir()
    with pytest.raises(InputError, match="lies in that of the slopes"):
        run_batch(
            Given(tmp_path / "slopes", tmp_path / "slopes" / "out"),
            Common({}, "default", None, None, BatchParameters()),
        )


def test_without_pdal_no_slope_is_begun(corridor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLOPEWATCH_PDAL", str(tmp_path / "no pdal"))
    common = Common({}, "default", None, None, BatchParameters())
    with pytest.raises(InputError, match="no pdal"):
        run_batch(Given(corridor / "corridor.csv", tmp_path / "out"), common)
    assert not (tmp_path / "out" / "slopes.jsonl").exists()


def test_the_command_refuses_what_it_cannot_use(corridor: Path, tmp_path: Path) -> None:
    from slopewatch.tests.builders.program import run

    for given, words in (
        (("gone.csv",), "gone.csv' does not exist; give a CSV file"),
        ((corridor / "corridor.csv", "--workers=-1"), "workers is -1; give a whole number from 0 to 1024."),
        ((corridor / "corridor.csv", "--scheduler=gone.json"), "'gone.json' does not exist; check its path."),
    ):
        done = run("batch", *given, "--ground-ready", "--output-dir", tmp_path / "out", env={**os.environ})
        assert done.returncode == 2, done.stderr
        assert words in done.stderr
