"""What a survey lacks, or holds too much of, is said in one sentence with its share; sound surveys are silent."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.ground.classified_ground import contradicting_share, warn_of_classes
from slopewatch.engine.ground.doubts import Found, ground_doubts
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.layered_ground import layered_ground
from slopewatch.engine.ground.stray_low import stray_below
from slopewatch.engine.pointcloud.pdal_program import find_pdal
from slopewatch.engine.pointcloud.returns import last_returns
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.plot import plot

SIDE = 20.0


def meadow(seed: int = 1, *, density: float = 60.0, grass: float = 0.0, hits: float = 0.3) -> np.ndarray:
    """Points (n, 3) of a slope; ``grass`` m high on all but a strip; ``hits`` of its returns are ground."""
    rng = np.random.default_rng(seed)
    n = int(density * SIDE**2)
    x, y = rng.uniform(0, SIDE, (2, n))
    z = 0.1 * np.sin(x / 3) + rng.normal(0, 0.015, n)
    plants = (rng.random(n) > hits) & (x > SIDE / 4)
    return np.column_stack([x, y, z + plants * rng.uniform(0, grass, n)])


def ground_of(xyz: np.ndarray, removed: np.ndarray | None = None) -> Found:
    taken = np.ones(len(xyz), dtype=bool)
    found = layered_ground(xyz, taken, taken, 0.06)
    none = np.empty((0, 3))
    left_out = none if removed is None else removed
    return Found(xyz, found.ground, taken, found.height, found.plant_error, left_out, found.threshold)


def doubts(xyz: np.ndarray, *, lost: float = 0.0, removed: np.ndarray | None = None) -> tuple[str, ...]:
    return ground_doubts("a.laz", ground_of(xyz, removed), lost)


def lowered(xyz: np.ndarray, share: float, seed: int = 2) -> np.ndarray:
    """The cloud, ``share`` of which lies 0.3 to 3 m lower."""
    rng = np.random.default_rng(seed)
    low = rng.random(len(xyz)) < share
    return np.column_stack([xyz[:, :2], xyz[:, 2] - low * rng.uniform(0.3, 3.0, len(xyz))])


@pytest.mark.parametrize("grass", [0.0, 0.5])
def test_a_sound_survey_is_silent(grass):
    assert doubts(meadow(grass=grass)) == ()


def test_a_survey_of_nothing_but_grass():
    rng = np.random.default_rng(3)
    xyz = meadow()
    xyz[:, 2] += 0.1 + 0.5 * rng.beta(1, 3, len(xyz))
    (said,) = doubts(xyz)
    assert "Nearly nothing of the ground of a.laz is bare (0" in said
    assert "expected error of" in said


@pytest.mark.parametrize("share", [0.005, 0.01, 0.05])
def test_stray_returns_below_the_ground(share):
    (said,) = doubts(lowered(meadow(), share))
    assert float(said.split(" %")[0]) == pytest.approx(100 * share, rel=0.25)
    assert "m below its ground" in said


def test_stray_returns_that_were_removed_as_outliers_count():
    xyz = meadow()
    below = xyz[:300] - [0, 0, 4.0]
    (said,) = doubts(xyz, removed=below)
    assert said.startswith("1.2 % of the returns of a.laz lie more than 0.2 m below")
    assert doubts(xyz, removed=below + [0, 0, 8.0]) == ()


@pytest.mark.parametrize(("number", "total", "share"), [([1, 1, 1, 1], [1, 1, 2, 3], 0.5), ([1, 1, 2], [1, 2, 2], 0.0)])
def test_the_share_of_pulses_without_their_last_return(number, total, share):
    repeat = np.repeat([number, total], 100, axis=1).astype(np.uint8)
    assert last_returns(*repeat).lost == pytest.approx(share)


def test_first_returns_only():
    (said,) = doubts(meadow(), lost=0.12)
    assert said.startswith("The last return of 12 % of the pulses of a.laz is missing")
    assert doubts(meadow(), lost=0.02) == ()


def test_a_cloud_thinned_to_a_point_a_cell():
    xyz = meadow(density=300.0)
    cell = np.floor(xyz[:, :2] / 0.4).astype(int)
    _, first = np.unique(cell, axis=0, return_index=True)
    (said,) = doubts(xyz[first])
    assert said.startswith("The points of a.laz lie as evenly as in a cloud thinned to one point a cell")
    assert " % of what chance makes" in said


def test_water_with_some_returns():
    xyz = meadow(density=200.0)
    pond = np.hypot(xyz[:, 0] - 10, xyz[:, 1] - 10) < 6
    kept = ~pond | (np.random.default_rng(4).random(len(xyz)) < 0.01)
    (said,) = doubts(xyz[kept])
    share = float(said.split(" %")[0])
    assert "of the area of a.laz has hardly any return (water" in said
    assert 18 < share < 32  # the pond is 28 % of it, less the cells on its shore


def test_a_gap_between_flight_lines_has_no_ground_and_is_left_to_the_facts_of_the_cover():
    xyz = meadow(density=200.0)
    xyz = xyz[(xyz[:, 1] < 7) | (xyz[:, 1] > 14)]
    found = ground_of(xyz)
    assert ground_doubts("a.laz", found, 0.0) == ()
    assert not ((xyz[found.ground, 1] > 7) & (xyz[found.ground, 1] < 14)).any()


@pytest.mark.parametrize(("grass", "limit"), [(0.0, 0.01), (1.0, 0.04)])
def test_stray_returns_do_not_lower_the_ground(grass, limit):
    survey = plot(
        SurveyParameters(seed=1, grass=grass, grass_height=0.7, vegetation=0.0, mown="never", multipath=0.05),
        slope=10.0,
    )
    xyz = survey.cloud.xyz
    middle = xyz[:, :2].mean(axis=0)
    from_slope = np.tan(np.radians(10.0))
    flat = np.column_stack([xyz[:, :2] - middle, xyz[:, 2] - from_slope * _uphill(survey, xyz)])
    last = survey.cloud.return_number == survey.cloud.number_of_returns
    ground = layered_ground(flat, last & (np.abs(survey.above) < 0.3), last, 0.06).ground
    above = survey.above[ground]
    assert np.mean(survey.above < -0.08) > 0.04  # the strays are there
    cell = np.unique(np.floor(xyz[ground, :2] / 0.5).astype(int), axis=0, return_inverse=True)[1].ravel()
    assert abs(np.mean(np.bincount(cell, above) / np.bincount(cell))) < limit


def _uphill(survey, xyz: np.ndarray) -> np.ndarray:
    """Distance uphill (n,), by the plane through the true ground."""
    base = np.column_stack([xyz[:, :2] - xyz[:, :2].mean(axis=0), np.ones(len(xyz))])
    truth = xyz[:, 2] - survey.above
    return base @ np.linalg.lstsq(base, truth, rcond=None)[0] / np.tan(np.radians(10.0))


def test_strays_are_told_from_ground_under_plants_and_walls():
    rng = np.random.default_rng(5)
    grassy = meadow(grass=0.6, hits=0.05, density=200.0)
    assert stray_below(grassy, 0.1).sum() == 0
    house = np.column_stack([rng.uniform(8, 12, (4000, 2)), np.full(4000, 5.0)])
    wall = np.column_stack([np.full(300, 8.0), rng.uniform(8, 12, 300), rng.uniform(0, 5, 300)])
    built = np.vstack([meadow(), wall, house])
    assert stray_below(built, 0.1).mean() < 0.001
    low = lowered(meadow(), 0.02)
    truth = low[:, 2] < -0.25
    found = stray_below(low, 0.1)
    assert (found & truth).sum() > 0.95 * truth.sum()
    assert (found & ~truth).sum() <= 0.001 * len(low)


def test_classes_that_contradict_themselves():
    progress = Progress()
    ground = meadow()
    warn_of_classes(Path("a.laz"), ground, progress.warning)
    steep = ground @ np.array([[1, 0, 0], [0, 1, 0], [0, 1.7, 1]]).T
    warn_of_classes(Path("a.laz"), steep, progress.warning)
    assert progress.warnings == []
    mixed = ground.copy()
    mixed[np.random.default_rng(6).random(len(mixed)) < 0.1, 2] += 0.6
    warn_of_classes(Path("a.laz"), mixed, progress.warning)
    (said,) = progress.warnings
    assert said.startswith(
        f"{100 * contradicting_share(mixed):.0f} % of the points of class 2 of 'a.laz' lie more than 0.3 m"
    )
    mixed[:, 2] += np.random.default_rng(7).uniform(0, 3, len(mixed))
    with pytest.raises(
        InputError, match=r"\d+ % of the points of class 2 of 'a.laz' .* no surface; extract its ground"
    ):
        warn_of_classes(Path("a.laz"), mixed, progress.warning)


def test_the_extraction_says_what_it_doubts(tmp_path):
    pdal = find_pdal()
    xyz = lowered(meadow(), 0.02)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (xyz + [500_000, 3_500_000, 50]).T
    las.return_number = np.ones(len(xyz), dtype=np.uint8)
    las.number_of_returns = np.where(np.arange(len(xyz)) % 10 == 0, 2, 1)
    las.write(tmp_path / "a.las")
    progress = Progress()
    result = extract_ground(tmp_path / "a.las", tmp_path / "a_ground.laz", pdal=pdal, progress=progress)
    doubted = [s for s in result.warnings if "below its ground" in s or "last return of" in s]
    assert len(doubted) == 2
    assert set(doubted) <= set(progress.warnings)
    assert doubted[0].startswith("The last return of 10 % of the pulses of ")
    assert float(doubted[1].split(" %")[0]) == pytest.approx(2.0, abs=0.5)
