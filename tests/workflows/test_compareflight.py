"""Surveys flown along planned lines with known deviations, which are found and named."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch import api
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_result import RunResult
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.layers import Landscape
from slopewatch.simulation.surveys.pattern import Scanner, WaypointFlight
from slopewatch.simulation.surveys.plants import cover_of
from slopewatch.simulation.surveys.scanner import scan
from slopewatch.simulation.surveys.scene import Relief
from slopewatch.simulation.surveys.survey import BuiltSlope, built_slope, expand, rectangle
from slopewatch.simulation.surveys.write import write_region, write_survey
from slopewatch.workflows.conclusions import conclusion

CRS_NAME, RATE = CRS.from_user_input("EPSG:32651"), 6000.0


@dataclass(frozen=True)
class Site:
    """A planned slope that can be flown."""

    folder: Path
    slope: BuiltSlope
    landscape: Landscape
    lines: list[np.ndarray]

    @property
    def plan(self) -> Path:
        return self.folder / "plan" / "plan.gpkg"

    def fly(self, name: str, lines: list[np.ndarray], sweeps: float = 60.0) -> Path:
        """The survey along ``lines`` (k, 3) with its ground as class 2, and next to it the trajectory."""
        scanner = replace(Scanner(), speed=3.0, pulse_rate=RATE, sweeps=sweeps)
        local = tuple(self.slope.scene.frame.to_local(line) for line in lines)
        flight = WaypointFlight(local, scanner)
        cloud = scan(self.landscape, flight, expand(self.slope.roi, 3.0), math.ceil(flight.pulses), 0.02, (7, 1))
        path = self.folder / f"{name}.las"
        write_survey(path, cloud, CRS_NAME, "2026-05-01")
        las = laspy.read(path)
        las.classification = np.where(np.asarray(las.truth_ground) == 1, 2, 5)
        las.write(path)
        # over the turns, too, at 3 m/s with ten places a second
        corners = np.concatenate(lines)
        gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
        seconds = np.arange(0.0, gone[-1] / 3.0, 0.1)
        places = np.column_stack([np.interp(3.0 * seconds, gone, corners[:, axis]) for axis in range(3)])
        rows = [
            "Time,X,Y,Z",
            *(f"{t:.2f},{x:.3f},{y:.3f},{z:.3f}" for t, (x, y, z) in zip(seconds, places, strict=True)),
        ]
        (self.folder / f"{name}.csv").write_text("\n".join(rows), encoding="utf-8")
        return path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    folder = tmp_path_factory.mktemp("site")
    survey = SurveyParameters(seed=3, vegetation=0.0, angle=35.0, points=90_000, length=60.0, height=24.0, offset=0.0)
    slope = built_slope(survey, Relief(), Frame(), 0.0, Progress())
    landscape = Landscape(slope.scene, slope.canopy, cover_of(survey, slope.scene, 0))
    write_region(folder / "roi.gpkg", rectangle(slope.roi, slope.scene.frame), CRS_NAME, date(2024, 5, 1))
    made = Site(folder, slope, landscape, [])
    cloud = scan(landscape, slope.plan, expand(slope.roi, 6.0), 90_000, 0.02, (3, 11))
    write_survey(folder / "last.las", cloud, CRS_NAME, "2024-05-01")
    las = laspy.read(folder / "last.las")
    las.points = las.points[np.asarray(las.truth_ground) == 1]
    las.write(folder / "ground.las")
    api.plan_flight(
        folder / "ground.las", folder / "roi.gpkg", folder / "plan", survey=folder / "last.las", pulse_rate=RATE,
        side_overlap=0.7, bridged_terrain=30.0,
    )  # fmt: skip
    lines = read_layer(made.plan, "lines").sort_values("line").geometry
    return replace(made, lines=[shapely.get_coordinates(line, include_z=True) for line in lines])


def compared(site: Site, name: str, cloud: Path, *, trajectory: bool = True) -> dict:
    given = site.folder / f"{cloud.stem}.csv" if trajectory else None
    api.compare_flight(site.plan, cloud, site.folder / name, trajectory=given)
    return json.loads((site.folder / name / "run.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def kept(site: Site) -> Path:
    return site.fly("kept", site.lines)


@pytest.mark.parametrize("trajectory", [True, False])
def test_a_flight_by_the_plan_keeps_it(site: Site, kept: Path, trajectory: bool) -> None:
    figures = compared(site, f"kept{trajectory}", kept, trajectory=trajectory)["metrics"]
    assert len(site.lines) >= 4
    assert figures["flown_lines"] == len(site.lines)
    assert figures["way_known_by"] == ("trajectory" if trajectory else "angles")
    assert figures["left_out"] == []
    assert figures["above_m"] == figures["aside_m"] == {}
    assert figures["largest_above_m"] < (0.01 if trajectory else 0.3)
    assert figures["ground_ratio"] == pytest.approx(1.0, abs=0.05)
    assert figures["verdict"] == "kept"


@pytest.mark.parametrize("trajectory", [True, False])
def test_a_line_left_out_and_one_ten_metres_too_high_are_named(site: Site, trajectory: bool) -> None:
    """The lowest line but one is not flown, the uppermost 10 m too high, its neighbour 4 m to the right."""
    lines = [line.copy() for line in site.lines]
    lines[-1][:, 2] += 10.0
    way = lines[-2][-1, :2] - lines[-2][0, :2]
    lines[-2][:, :2] += 4.0 * np.array([way[1], -way[0]]) / np.hypot(*way)
    del lines[1]
    name = f"deviating{trajectory}"
    record = compared(site, name, site.fly(f"flown{trajectory}", lines), trajectory=trajectory)
    figures, last = record["metrics"], len(site.lines)
    assert figures["left_out"] == [2]
    assert set(figures["above_m"]) == {str(last)}
    assert figures["above_m"][str(last)] == pytest.approx(10.0, abs=0.01 if trajectory else 0.3)
    assert set(figures["aside_m"]) == {str(last - 1)}
    assert figures["aside_m"][str(last - 1)] == pytest.approx(4.0, abs=0.01 if trajectory else 0.3)
    assert figures["verdict"] == "lines and places"
    said = conclusion("compareflight", RunResult(outputs={"run": site.plan}, figures=figures))
    assert said[1] == f"{last - 1} of {last} planned lines were flown; left out: 2."
    assert said[2].endswith(f"higher): {last - 1} (+4.0, +0.0), {last} (+0.0, +10.0).")
    assert said[4] == f"{figures['short_places']} of {figures['judged_places']} places fell short by more than 15 %."
    places = read_layer(site.folder / name / "comparison.gpkg", "places")
    assert int(places["short"].sum()) == figures["short_places"] > 0.2 * len(places)
    table = (site.folder / name / "lines.csv").read_text(encoding="utf-8").splitlines()
    assert table[2].startswith("2,left out,0.0,,")


def test_counts_of_a_place_are_those_of_the_file(site: Site, kept: Path) -> None:
    compared(site, "counts", kept)
    places = read_layer(site.folder / "counts" / "comparison.gpkg", "places")
    las = laspy.read(kept)
    xy = np.column_stack([las.x, las.y])
    for place in places.iloc[:: max(1, len(places) // 15)].itertuples():
        west, south, east, north = place.geometry.bounds
        inside = (xy[:, 0] >= west) & (xy[:, 0] < east) & (xy[:, 1] > south) & (xy[:, 1] <= north)
        area = place.geometry.area
        assert place.returns_reached_m2 == pytest.approx(inside.sum() / area, abs=6 / area)
        ground = (inside & (np.asarray(las.classification) == 2)).sum()
        assert place.ground_reached_m2 == pytest.approx(ground / area, abs=6 / area)


def test_without_a_line_its_returns_are_missing(site: Site, kept: Path) -> None:
    las = laspy.read(kept)
    numbers = np.asarray(las.point_source_id)
    own = numbers == np.unique(numbers)[1]
    before = compared(site, "whole", kept)["metrics"]
    las.points = las.points[~own]
    las.write(site.folder / "without.las")
    figures = compared(site, "without", site.folder / "without.las", trajectory=False)["metrics"]
    assert figures["left_out"] == [2]
    assert figures["flown_lines"] == len(site.lines) - 1
    whole, without = (read_layer(site.folder / name / "comparison.gpkg", "places") for name in ("whole", "without"))
    lost = (whole["returns_reached_m2"] - without["returns_reached_m2"]).sum()
    xy = laspy.read(kept).xyz[own][:, :2]
    places = shapely.union_all(whole.geometry.values)
    area = whole.geometry.area.iloc[0]
    assert lost * area == pytest.approx(shapely.contains_xy(places, *xy.T).sum(), rel=0.01)
    assert figures["ground_ratio"] < before["ground_ratio"] - 0.05
    assert figures["short_places"] > before["short_places"]


def test_angles_counted_to_the_left_show_the_same_way(site: Site, kept: Path) -> None:
    """Only one sign puts the carrier over the ground; a real survey of 2010 counts them so."""
    las = laspy.read(kept)
    las.scan_angle = -np.asarray(las.scan_angle)
    las.write(site.folder / "left.las")
    figures = compared(site, "left", site.folder / "left.las", trajectory=False)["metrics"]
    assert figures["way_known_by"] == "angles"
    assert figures["flown_lines"] == len(site.lines)
    assert figures["above_m"] == figures["aside_m"] == {}
    assert figures["largest_above_m"] < 0.3


def test_a_rosette_shows_its_lines_where_its_angles_are_signed_and_only_densities_else(site: Site) -> None:
    cloud = site.fly("cone", site.lines, sweeps=0.0)
    figures = compared(site, "rosette", cloud, trajectory=False)["metrics"]
    assert figures["flown_lines"] == len(site.lines)
    assert figures["largest_above_m"] < 0.5
    las = laspy.read(cloud)
    las.scan_angle = np.abs(np.asarray(las.scan_angle))
    las.write(cloud)
    record = compared(site, "unsigned", cloud, trajectory=False)
    assert record["metrics"]["way_known_by"] == "none"
    assert "flown_lines" not in record["metrics"]
    assert any("only densities are compared" in warning for warning in record["warnings"])
    strips = (site.folder / "unsigned" / "strips.csv").read_text(encoding="utf-8").splitlines()
    assert len(strips) == 1 + len(site.lines)


def test_a_cloud_cut_to_the_region_is_not_short_at_its_rim(site: Site, kept: Path) -> None:
    las = laspy.read(kept)
    region = shapely.union_all(read_layer(site.folder / "roi.gpkg").geometry.values)
    las.points = las.points[shapely.contains_xy(region, np.asarray(las.x), np.asarray(las.y))]
    las.write(site.folder / "cut.las")
    api.compare_flight(site.plan, site.folder / "cut.las", site.folder / "cut", trajectory=site.folder / "kept.csv")
    record = json.loads((site.folder / "cut" / "run.json").read_text(encoding="utf-8"))
    assert record["metrics"]["verdict"] == "kept"
    assert any("rim" in warning for warning in record["warnings"])


def test_what_cannot_be_compared_is_refused_and_nothing_is_written(site: Site, kept: Path) -> None:
    wrong = site.folder / "wrong.csv"
    far = laspy.read(kept)
    far.x = np.asarray(far.x) + 5000.0
    far.write(site.folder / "far.las")
    for text, words in (
        ("t,x,y\n1,2,3\n", "no column time"),
        ("time,x,y,z\n1,2,3,four\n", "Line 2 of .* holds no four numbers"),
        ("time,x,y,z\n1,2,3,4\n", "holds 1 places"),
        ("time,x,y,z\n1,500050,3299930,195\n2,5000500,3299930,195\n", "a way of 4,500 km"),
        ("time,x,y,z\n1,1e308,0,9\n2,-1e308,0,9\n", "a way of"),
    ):
        wrong.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            api.compare_flight(site.plan, kept, site.folder / "refused", trajectory=wrong)
    with pytest.raises(InputError, match="no return in the region"):
        api.compare_flight(site.plan, site.folder / "far.las", site.folder / "refused")
    with pytest.raises(InputError, match=r"layer lines|no flight lines"):
        api.compare_flight(site.folder / "roi.gpkg", kept, site.folder / "refused")
    assert not (site.folder / "refused").exists()
