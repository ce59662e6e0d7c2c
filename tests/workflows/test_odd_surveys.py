"""One survey that does not fit into its series: a sentence names it, and the rest of the series is as without it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.manifest import epochs_of
from slopewatch.tests.builders.series_clouds import GROWING, plane
from slopewatch.workflows.series import monitor_series

DAYS = ("2024-01-10", "2024-02-10", "2024-03-10", "2024-04-10", "2024-05-10")
STEP_M = -0.05  # of the square of 9 m2, from survey to survey


class Series:
    """A folder of surveys and what its run gives."""

    def __init__(self, folder: Path, earlier: Path | None = None) -> None:
        self.folder, self.out = folder / "clouds", folder / "out"
        self.folder.mkdir(parents=True)
        if earlier is not None:
            for path in (earlier / "clouds").iterdir():
                shutil.copy(path, self.folder)
            shutil.copytree(earlier / "out", self.out)

    def run(self, *, fresh: bool = False) -> Series:
        self.progress = Progress()
        monitor_series(epochs_of(self.folder), self.out, GROWING, overwrite=fresh, progress=self.progress)
        self.record: dict[str, Any] = json.loads((self.out / "run.json").read_text())
        self.zones = gpd.read_file(self.out / "series.gpkg", layer="zones")
        self.rows = gpd.read_file(self.out / "series.gpkg", layer="series")
        return self

    def said(self, *words: str) -> str:
        """The only new sentence of the run, which the record and the report have, too."""
        (sentence,) = [w for w in self.record["warnings"] if "is not that of the earlier run" not in w]
        assert all(word in sentence for word in words), sentence
        assert sentence in self.progress.warnings
        page = (self.out / "report.html").read_text(encoding="utf-8")
        assert sentence[:40].replace("'", "&#39;") in page
        return sentence

    def files(self) -> dict[str, bytes]:
        """Tables and rasters, by name."""
        found = [*self.out.glob("*/*.tif"), self.out / "series.csv", self.out / "coverage.csv"]
        return {path.relative_to(self.out).as_posix(): path.read_bytes() for path in found}


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Series:
    series = Series(tmp_path_factory.mktemp("plain"))
    for number, day in enumerate(DAYS):
        plane(series.folder / f"{day}.laz", bump=STEP_M * number, seed=number)
    series.run()
    assert series.record["warnings"] == []
    assert len(series.zones) == 1
    assert series.zones["vol_net_m3"].iloc[0] == pytest.approx(4 * STEP_M * 9, rel=0.05)
    return series


@pytest.fixture
def series(plain: Series, tmp_path: Path) -> Series:
    """The same folder, ready for one more survey."""
    return Series(tmp_path / "more", plain.folder.parent)


def rest_is_right(found: Series, plain: Series) -> None:
    """One zone, with the alert level and, within their errors, the volumes and the volume a day that it has without."""
    assert len(found.zones) == len(plain.zones) == 1
    (zone,), (want,) = found.zones.itertuples(), plain.zones.itertuples()
    assert (zone.zone_id, zone.alert_level) == (want.zone_id, want.alert_level)
    assert zone.vol_net_m3 == pytest.approx(want.vol_net_m3, abs=2 * want.vol_err_m3)
    assert zone.rate_mm_day * zone.area_m2 == pytest.approx(want.rate_mm_day * want.area_m2, rel=0.05)
    before, after = (frame.set_index("epoch") for frame in (plain.rows, found.rows))
    for day, row in before.iterrows():
        assert after.loc[day, "vol_net_m3"] == pytest.approx(row["vol_net_m3"], abs=2 * row["vol_err_m3"])
        assert after.loc[day, "alert_level"] == row["alert_level"]


def same_as_without(found: Series, plain: Series) -> None:
    assert found.files() == plain.files()
    assert [i["role"] for i in found.record["inputs"]] == [i["role"] for i in plain.record["inputs"]]


def test_two_on_one_day_keep_the_one_with_more_points(plain, tmp_path):
    series = Series(tmp_path / "more")
    for path in plain.folder.iterdir():
        shutil.copy(path, series.folder)
    plane(series.folder / "2024-03-10_again.laz", bump=2 * STEP_M, seed=9, points=5_000)
    series.run().said("2024-03-10_again.laz' is left out", "2024-03-10.laz' is of the same day", "merge the two")
    same_as_without(series, plain)


def test_the_survey_that_an_earlier_run_used_stays(series, plain):
    plane(series.folder / "2024-03-10_again.laz", bump=2 * STEP_M, seed=9, points=20_000)
    series.run().said("2024-03-10_again.laz' is left out")
    same_as_without(series, plain)


def test_all_on_one_day_are_no_series(tmp_path):
    for name in ("a", "b"):
        plane(tmp_path / f"2024-01-10{name}.laz", seed=ord(name))
    with pytest.raises(InputError, match="All surveys have the same date, 2024-01-10"):
        monitor_series(epochs_of(tmp_path), tmp_path / "out", GROWING)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("day", ["2023-12-10", "2024-03-25"])
def test_another_slope_is_left_out_wherever_it_stands(plain, tmp_path, day):
    series = Series(tmp_path / "more")
    for path in plain.folder.iterdir():
        shutil.copy(path, series.folder)
    plane(series.folder / f"{day}.laz", x=9.5, seed=9)
    series.run().said(f"{day}.laz' is left out", "shares ", " % of its extent with the survey of 2024-01-10")
    same_as_without(series, plain)


def test_another_slope_before_a_series_that_goes_on(series, plain):
    plane(series.folder / "2023-12-10.laz", x=300.0, seed=9)
    series.run().said("2023-12-10.laz' is left out", "shares 0 % of its extent")
    same_as_without(series, plain)


def test_a_day_apart_gives_no_velocity_and_no_alert(series, plain):
    # the survey of the next day is off by 3 cm in the zone: 30 mm a day
    plane(series.folder / "2024-05-11.laz", bump=4 * STEP_M - 0.03, seed=9)
    series.run().said("2024-05-10 and 2024-05-11 are less than 7 days apart: they count as one")
    last = series.rows.set_index("epoch").loc["2024-05-11"]
    assert last["days_before"] == 1
    assert abs(last["step_m"] * last["area_m2"] + 0.03 * 9) < 2 * last["step_err_m"] * last["area_m2"]
    assert last["step_m"] < -3 * last["step_err_m"]
    assert np.isnan(last["rate_mm_day"])
    assert series.zones["rate_last"].isna().all()
    assert last["alert_level"] == plain.zones["alert_level"].iloc[0]
    figures = [run.record["metrics"]["detectable_rate_mm_day"] for run in (series, plain)]
    assert figures[0] == pytest.approx(figures[1], rel=0.1)
    assert "rate" in last["alert_reason"]
    (zone,), (want,) = series.zones.itertuples(), plain.zones.itertuples()
    assert zone.rate_mm_day * zone.area_m2 == pytest.approx(want.rate_mm_day * want.area_m2, rel=0.1)


def test_surveys_of_one_week_alone_have_no_velocity(tmp_path):
    series = Series(tmp_path / "week")
    for number in range(3):
        plane(series.folder / f"2024-01-1{number}.laz", bump=STEP_M * number, seed=number)
    series.run().said("All surveys lie within 7 days: no velocity")
    assert len(series.zones) == 1
    assert series.zones["rate_mm_day"].isna().all()
    assert series.zones["velocity_class"].tolist() == [""]
    assert series.record["metrics"]["fastest_rate_mm_day"] is None
    assert series.record["metrics"]["highest_alert"] <= 1


def test_a_gap_of_years_is_told(series, plain):
    plane(series.folder / "2027-05-10.laz", bump=4 * STEP_M, seed=9)
    series.run().said("for 3.0 years, from 2024-05-10 to 2027-05-10", "known as a mean only")
    before, after = (frame.set_index("epoch") for frame in (plain.rows, series.rows))
    for day, row in before.iterrows():
        assert after.loc[day, "vol_net_m3"] == pytest.approx(row["vol_net_m3"], abs=2 * row["vol_err_m3"])
        assert after.loc[day, "alert_level"] == row["alert_level"]
    assert series.zones["vol_net_m3"].iloc[0] == pytest.approx(4 * STEP_M * 9, rel=0.05)
    last = after.loc["2027-05-10"]
    assert abs(last["rate_mm_day"]) < 2 * last["rate_err"]


def test_only_the_cells_of_the_sparse_survey_grow(series, plain):
    plane(series.folder / "2024-03-25.laz", bump=2.5 * STEP_M, seed=9, points=1_200)
    series.run().said("2024-03-25 has 10 % of the point density of the others", "small zones are missed there")
    rest_is_right(series, plain)
    cells = {row["epoch"]: row["cell_median_m"] for row in series.record["coverage"]}
    usual = {row["epoch"]: row["cell_median_m"] for row in plain.record["coverage"]}
    assert cells.pop("2024-03-25") >= 2 * max(usual.values())
    assert cells == usual
    sparse = series.rows.set_index("epoch").loc["2024-03-25"]
    assert sparse["vol_net_m3"] == pytest.approx(2.5 * STEP_M * 9, abs=2 * sparse["vol_err_m3"])


@pytest.fixture(scope="module")
def marches(tmp_path_factory) -> Series:
    """Surveys of each March; the ground found under grass is a quarter of its height too high."""
    series = Series(tmp_path_factory.mktemp("marches"))
    for number in range(4):
        plane(series.folder / f"{2020 + number}-03-10.laz", bump=STEP_M * number, seed=number, grass=0.02)
    return series.run()


def test_a_summer_is_told_and_does_not_count(marches, tmp_path):
    series = Series(tmp_path / "more", marches.folder.parent)
    plane(series.folder / "2023-07-20.laz", bump=3 * STEP_M, seed=9, grass=0.4)
    series.run().said("2023-07-20 is of another season", "does not count where vegetation can explain")
    rest_is_right(series, marches)


def test_the_first_survey_is_of_another_season(marches, tmp_path):
    series = Series(tmp_path / "more")
    for path in marches.folder.iterdir():
        shutil.copy(path, series.folder)
    plane(series.folder / "2019-07-20.laz", seed=9, grass=0.4)
    series.run()
    (said,) = [w for w in series.record["warnings"] if "season" in w]
    assert said.startswith("The first survey, 2019-07-20, is of another season than all others")
    assert said.endswith("leave it out if you can.")
    assert series.record["metrics"]["highest_alert"] == 0


def test_days_tell_a_season_if_the_vegetation_is_not_known(tmp_path):
    series = Series(tmp_path / "days")
    for number, day in enumerate(("2022-03-10", "2023-03-20", "2023-07-20", "2024-03-01")):
        plane(series.folder / f"{day}.laz", seed=number)
    series.run().said("Only the survey of 2023-07-20 is of another season", "the vegetation is not known")
