"""Series without change, damaged ones, and what is refused in one sentence with nothing written."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import geopandas
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.manifest import epochs_of
from slopewatch.interface.parameters import GridChangeParameters, InputParameters
from slopewatch.tests.builders.series_clouds import FIXED, plane
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings


def test_a_survey_that_rose_as_a_whole_makes_no_zones(tmp_path):
    for number, raised in enumerate((0.0, 0.0, 0.2, 0.0)):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", raised=raised, bump=0.1 * number, seed=number)
    progress = Progress()
    # known to be exact: else the registration's own misfit widens that survey's level instead
    exact = replace(FIXED, change=GridChangeParameters(cell=0.25, registration_error=0.005))
    monitor_series(epochs_of(tmp_path), tmp_path / "out", exact, progress=progress)
    assert [w for w in progress.warnings if w.startswith("2024-03-01: The whole overlap has risen by about 0.2")]
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert len(zones) == 1
    assert zones["area_m2"].iloc[0] == pytest.approx(9.0, rel=0.2)
    assert zones["n_epochs"].iloc[0] == 3  # the biased one tells nothing
    volume_a_day = zones["rate_mm_day"].iloc[0] * zones["area_m2"].iloc[0] / 1000
    assert volume_a_day == pytest.approx(9 * 0.3 / 91, rel=0.1)


def test_no_change_gives_outputs_without_zones(tmp_path):
    for number in range(3):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", seed=number)
    done = monitor_series(epochs_of(tmp_path), tmp_path / "out", FIXED)
    outputs, metrics = done.outputs, done.figures
    assert metrics["zone_count"] == metrics["highest_alert"] == 0
    assert metrics["fastest_rate_mm_day"] is None
    assert all(path.is_file() for path in outputs.values())
    assert geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="series").empty


def test_own_alert_table_decides(tmp_path):
    for number in range(3):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", bump=-0.2 * number, seed=number)
    metrics = monitor_series(epochs_of(tmp_path), tmp_path / "out", FIXED).figures
    table = (tmp_path / "out" / "alerts_used.csv").read_text()
    mine = tmp_path / "mine.csv"
    rows = [line for line in table.splitlines() if line[0] not in "34"]
    mine.write_text(
        "\n".join(rows).replace("2,inspect,#f2c037,2,1,60,,5,", "2,close the road,#f2c037,2,1,60,,5,") + "\n"
    )
    other = monitor_series(epochs_of(tmp_path), tmp_path / "out", FIXED, alerts=mine).figures
    assert (metrics["highest_alert"], other["highest_alert"]) == (3, 2)
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert zones["alert"].tolist() == ["close the road"]
    assert (tmp_path / "out" / "alerts_used.csv").read_text() == mine.read_text()


def test_a_damaged_entry_is_made_again(tmp_path):
    for number in range(2):
        plane(tmp_path / f"2024-0{number + 1}-01.laz", seed=number)
    out = tmp_path / "out"
    monitor_series(epochs_of(tmp_path), out, FIXED)
    kept = sorted((out / "work").glob("*_cells.npz"))
    good = kept[0].read_bytes()
    kept[0].write_bytes(good[:-100] + b"x" * 100)
    next((out / "work").glob("*_transform.facts.json")).write_text("{")
    progress = Progress()
    monitor_series(epochs_of(tmp_path), out, FIXED, progress=progress)
    assert len([w for w in progress.warnings if "was damaged since it was kept and is made again" in w]) == 2
    assert kept[0].read_bytes() == good


class TestBadInput:
    """Each gets one sentence, and nothing is written."""

    @pytest.fixture
    def folder(self, tmp_path):
        (tmp_path / "clouds").mkdir()
        for number in range(3):
            plane(tmp_path / "clouds" / f"2024-0{number + 1}-01.laz", seed=number)
        return tmp_path / "clouds"

    def refused(self, folder: Path, sentence: str, settings: SeriesSettings = FIXED, **options) -> None:
        out = folder.parent / "out"
        with pytest.raises(InputError, match=sentence):
            monitor_series(epochs_of(folder), out, settings, **options)
        assert not out.exists()

    def test_other_reference_system(self, folder):
        plane(folder / "2024-04-01.laz", crs=32650, seed=9)
        self.refused(folder, r"different reference systems: 2024-01-01.laz .* 2024-04-01.laz .*reproject")

    def test_no_overlap(self, folder):
        # of more surveys the odd one is left out: test_odd_surveys.py
        for path in sorted(folder.iterdir())[1:]:
            path.unlink()
        plane(folder / "2024-04-01.laz", x=300.0, seed=9)
        self.refused(folder, "surveys of 2024-01-01 and 2024-04-01 do not overlap: .*x 500000.0 to .*x 500300.0")

    def test_the_same_cloud_twice(self, folder):
        shutil.copy(folder / "2024-01-01.laz", folder / "2024-04-01.laz")
        self.refused(folder, "are the same cloud")

    def test_one_survey(self, folder):
        for path in sorted(folder.iterdir())[1:]:
            path.unlink()
        self.refused(folder, "One survey was given; a series takes at least two")

    def test_broken_alert_table(self, folder):
        (folder.parent / "alerts.csv").write_text("level,name\n0,none\n")
        self.refused(folder, "alert table .* column colour is missing", alerts=folder.parent / "alerts.csv")

    def test_missing_alert_table(self, folder):
        self.refused(folder, r"nothing\.csv' does not exist", alerts=folder.parent / "nothing.csv")

    def test_region_away_from_the_surveys(self, folder):
        from shapely import box

        region = folder.parent / "roi.gpkg"
        geopandas.GeoDataFrame(geometry=[box(0, 0, 10, 10)], crs=32651).to_file(region)
        self.refused(folder, "no point inside the region", roi=region)

    def test_output_that_is_an_input(self, folder):
        alerts = folder / "alerts_used.csv"
        alerts.write_text("x")
        with pytest.raises(InputError):
            monitor_series(epochs_of(folder), folder, FIXED, alerts=alerts)
        assert alerts.read_text() == "x"

    def test_damaged_cloud_leaves_nothing(self, folder):
        cloud = folder / "2024-03-01.laz"
        cloud.write_bytes(cloud.read_bytes()[:20_000])
        self.refused(folder, r"2024-03-01\.laz")

    def test_cloud_without_reference_system(self, folder):
        settings = replace(FIXED, inputs=InputParameters(crs="EPSG:4326"))
        self.refused(folder, "4326|geographic|degrees", settings)
