"""The ground under plants where the truth is known: edges, canopies, seams of tiles, grass and the error it makes."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.engine.geometry.dominant_plane import apply_matrix, flattening_matrix
from slopewatch.engine.ground import layered_ground as module
from slopewatch.engine.ground.cloth import cloth_ground
from slopewatch.engine.ground.filtering import cloth_threshold, dominant_plane, ground_mask, known_ground, refined
from slopewatch.engine.ground.layered_ground import LayeredGround, layered_ground, plant_error
from slopewatch.engine.ground.lowest_layer import BINS, lowest_layers
from slopewatch.engine.ground.surface_heights import surface_heights
from slopewatch.interface.parameters import GroundParameters
from slopewatch.simulation.surveys.plot import grass_plot
from slopewatch.tests.builders.ground_shapes import NOISE, field, shares, with_plants

CELL = 0.5


def ground_of(xyz: np.ndarray, near: np.ndarray | None = None, threshold: float = 0.06) -> LayeredGround:
    everything = np.ones(len(xyz), dtype=bool)
    return layered_ground(xyz, everything if near is None else near, everything, threshold)


def test_ground_is_told_from_leaves_that_begin_just_above_it():
    xy = field(60_000, 12.0)
    height = 0.1 * np.sin(xy[:, 0])
    xyz, ground = with_plants(xy, height)
    found = ground_of(xyz)
    recall, precision = shares(found.ground, ground)
    assert recall > 0.97
    assert precision > 0.98
    assert found.bare.mean() > 0.9
    assert found.threshold == 0.06
    assert np.abs(found.height - (xyz[:, 2] - height)).mean() < 0.01
    assert np.nanmedian(found.plant_height) == pytest.approx(np.median(xyz[:, 2] - height), abs=0.03)


def test_a_step_and_a_cone_are_ground_and_what_lies_around_them_too():
    xy = field(60_000, 12.0)
    from_step = np.abs(xy - [3.0, 6.0]).max(axis=1)
    from_top = np.hypot(*(xy - [9.0, 6.0]).T)
    cone = np.clip(0.36 * (1 - from_top), 0, None)
    xyz, ground = with_plants(xy, np.where(from_step < 0.75, 0.16, 0.0) + cone)
    found = ground_of(xyz).ground
    for place, least in ((from_step < 0.6, 0.85), (from_top < 1.0, 0.88), ((from_step > 1) & (from_top > 1.2), 0.98)):
        assert shares(found[place], ground[place])[0] > least
    inner = from_step < 0.6
    assert np.mean(xyz[found & inner, 2]) == pytest.approx(0.16, abs=0.01)


def test_a_step_without_plants_is_not_taken_for_plants():
    """In the windows on it nothing lies as low as the ground around, so there is nothing that it could grow on."""
    xy = field(60_000, 12.0)
    step = np.abs(xy - 6.0).max(axis=1)
    xyz, _ = with_plants(xy, np.where(step < 0.75, 0.16, 0.0), share=0.0)
    assert ground_of(xyz).ground[step < 0.6].mean() > 0.97


def test_ground_beyond_the_cloths_reach_is_found_from_the_ground_beside_it():
    xy = field(60_000, 12.0)
    # the cloth lies above and below a berm that falls at 45 degrees for 2.5 m, but not on it
    xyz, ground = with_plants(xy, -np.clip(xy[:, 0] - 5.0, 0, 2.5))
    near = (np.abs(xyz[:, 2]) < 0.3) | (xyz[:, 2] < -2.2)
    berm = (xy[:, 0] > 5.5) & (xy[:, 0] < 7.0)
    assert not (near & ground)[berm].any()
    found = ground_of(xyz, near)
    assert shares(found.ground[berm], ground[berm])[0] > 0.75
    assert shares(found.ground, ground)[0] > 0.9
    assert shares(found.ground, ground)[1] > 0.99


@pytest.mark.parametrize("incline", [0.5, 0.9])
def test_a_road_below_the_slope_is_bare_ground_though_it_rises_in_the_slopes_frame(incline):
    """The cloth does not reach it, triangles see it steeply, and noise along the frame's axis seems larger on it."""
    xy = field(60_000, 12.0)
    road = xy[:, 0] > 7.0
    rise = np.where(road, incline * (xy[:, 0] - 7.0), 0.0)
    noise = np.random.default_rng(5).normal(0, NOISE, len(xy)) * np.where(road, np.hypot(1.0, incline), 1.0)
    found = ground_of(np.column_stack([xy, rise + noise]), xy[:, 0] < 7.3)
    on_it = xy[:, 0] > 8.0
    assert found.ground[on_it].mean() > 0.92
    assert found.bare[on_it].mean() > 0.85
    assert np.mean((rise + noise - rise)[found.ground & on_it]) == pytest.approx(0.0, abs=0.003)


def test_bare_ground_as_rough_as_scanners_leave_it_keeps_its_mean():
    xy = field(40_000, 12.0)
    xyz = np.column_stack([xy, np.random.default_rng(2).normal(0, NOISE, len(xy))])
    found = ground_of(xyz)
    assert found.ground.mean() > 0.99
    assert abs(xyz[found.ground, 2].mean()) < 0.001
    assert np.median(found.plant_error) == 0.0


def test_sparse_returns_are_gathered_in_wider_windows_with_a_wider_threshold():
    sparse, dense = (with_plants(field(count, 30.0), np.zeros(count), share=0.2)[0] for count in (4_000, 100_000))
    wide, narrow = ground_of(sparse), ground_of(dense)
    assert wide.scatter > 1.4 * narrow.scatter
    assert wide.threshold == pytest.approx(max(2.5 * wide.scatter, module.SPARSE_THRESHOLD_M))
    assert narrow.threshold == 0.06
    assert abs(sparse[wide.ground, 2].mean()) < 0.01


def test_a_closed_canopy_without_ground_below_has_none_and_no_height():
    xy = field(80_000, 20.0)
    inside = np.abs(xy - 10.0).max(axis=1) < 5.0
    xyz, ground = with_plants(xy, np.zeros(len(xy)))
    xyz[inside, 2] = np.random.default_rng(3).uniform(4.0, 12.0, inside.sum())
    found = ground_of(xyz)
    assert not found.ground[inside].any()
    assert shares(found.ground[~inside], ground[~inside])[0] > 0.92
    middle = np.abs(xy - 10.0).max(axis=1) < 2.5
    for values in (found.height, found.plant_error, found.plant_height):
        assert np.isnan(values[middle]).all()
        assert np.isfinite(values[~inside]).mean() > 0.98
    # within four cells of known ground the height of a crown is told
    beside = inside & (np.abs(xy - 10.0).max(axis=1) > 4.2)
    assert np.abs(found.height - xyz[:, 2])[beside & np.isfinite(found.height)].max() < 0.05
    assert np.isfinite(found.height[beside]).mean() > 0.5


def test_only_points_that_may_be_ground_are_and_the_others_have_heights():
    xyz, ground = with_plants(field(40_000, 10.0), np.zeros(40_000))
    taken = np.random.default_rng(4).random(len(xyz)) < 0.7
    found = layered_ground(xyz, np.ones(len(xyz), dtype=bool), taken, 0.06)
    assert not found.ground[~taken].any()
    assert shares(found.ground[taken], ground[taken])[0] > 0.95
    assert np.abs(found.height - xyz[:, 2])[~taken].mean() < 0.01
    nothing = layered_ground(xyz, taken, np.zeros(len(xyz), dtype=bool), 0.06)
    assert not nothing.ground.any()
    assert np.isnan(nothing.height).all()


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_points_are_no_ground(count):
    found = ground_of(np.zeros((count, 3)))
    assert not found.ground.any()
    assert found.height.shape == found.plant_error.shape == (count,)
    assert np.isnan(found.height).all()


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    "xyz",
    [
        np.column_stack([np.arange(3000) * 0.01, np.zeros((3000, 2))]),
        np.column_stack([np.arange(3000) * 0.01, np.arange(3000) * 0.02, np.zeros(3000)]),
        np.repeat(np.column_stack([field(2000, 5.0), np.zeros(2000)]), 3, axis=0),
        np.column_stack([field(3000, 1.0) * [0.3, 20.0], np.zeros(3000)]),
        np.column_stack([field(200, 40.0), np.zeros(200)]),
    ],
    ids=["line", "oblique line", "each point three times", "narrower than a window", "few"],
)
def test_level_ground_of_any_layout_is_ground(xyz):
    found = ground_of(xyz)
    assert found.ground.mean() > 0.98
    # two bins of the layers' histograms
    assert np.nanmax(np.abs(found.height)) < 0.01


def test_the_order_of_points_and_the_place_do_not_matter():
    xyz, _ = with_plants(field(40_000, 10.0), np.zeros(40_000))
    # as a file holds them; many of one cell are equally high
    xyz = np.round(xyz, 3)
    found = ground_of(xyz)
    order = np.random.default_rng(5).permutation(len(xyz))
    shuffled, moved = ground_of(xyz[order]), ground_of(xyz + [500_000.0, 3_500_000.0, 800.0])
    assert np.array_equal(shuffled.ground, found.ground[order])
    assert shuffled.height == pytest.approx(found.height[order], abs=1e-9, nan_ok=True)
    assert np.count_nonzero(moved.ground != found.ground) < 0.001 * np.count_nonzero(found.ground)
    again = ground_of(xyz)
    assert np.array_equal(again.height, found.height, equal_nan=True)


def test_tiles_change_the_ground_by_no_more_than_their_seams(monkeypatch):
    xy = field(40_000, 20.0)
    xyz, _ = with_plants(xy, 0.3 * np.sin(xy[:, 0] / 2) * np.cos(xy[:, 1] / 3))
    whole = ground_of(xyz)
    monkeypatch.setattr(module, "TILE_M", 6.0)
    monkeypatch.setattr(module, "MARGIN_M", 3.0)
    tiled = ground_of(xyz)
    assert np.count_nonzero(whole.ground != tiled.ground) < 0.01 * np.count_nonzero(whole.ground)
    assert np.nanquantile(np.abs(whole.height - tiled.height), 0.99) < 0.01


def test_a_strip_across_the_axes_takes_no_memory_by_its_bounding_box():
    rng = np.random.default_rng(6)
    along, across = rng.uniform(0, 700, 20_000), rng.uniform(0, 6, 20_000)
    strip = np.column_stack([(along - across), (along + across), rng.normal(0, NOISE, 20_000)])
    tracemalloc.start()
    try:
        height = surface_heights(strip, np.ones(20_000, dtype=bool), np.ones(20_000, dtype=bool)).height
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert np.abs(height).mean() < 3 * NOISE
    # two coordinates of each node of the box would be 125 MB
    assert peak < 110e6


def test_windows_with_little_ground_and_wide_ones_have_larger_errors():
    counts = np.zeros((3, BINS))
    counts[:, 55:65] = np.array([100.0, 20.0, 4.0])[:, None]
    counts[:, 80:140] = 10
    layers = lowest_layers(counts, 0.016, 0.06)
    errors = plant_error(layers, 1.0)
    assert 0.012 < errors[0] < errors[1] < errors[2]
    assert plant_error(layers, 1.5) == pytest.approx(errors * 1.5**3)


@dataclass(frozen=True)
class Grass:
    """Of the cells of a plot of grass in which ground was found: its mean height over the true one and stated error."""

    bias: np.ndarray
    error: np.ndarray
    share: float


def grass_cells(state: str, slope: float) -> Grass:
    plot = grass_plot(1, side=8.0, density=700.0, state=state, slope=slope)
    xyz, last = plot.cloud.xyz, plot.cloud.return_number == plot.cloud.number_of_returns
    plane = dominant_plane(xyz)
    flat = apply_matrix(flattening_matrix(plane), xyz)
    parameters = GroundParameters()
    near = np.zeros(len(xyz), dtype=bool)
    near[last] = cloth_ground(flat[last], parameters, threshold=cloth_threshold(parameters))
    found = refined(flat, near, last, parameters)
    cell = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / CELL).astype(int)
    key = cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]
    chosen = found.ground
    number = np.bincount(key[chosen], minlength=key.max() + 1)
    known = number > 0
    bias, error = (
        np.bincount(key[chosen], values[chosen], len(number))[known] / number[known]
        for values in (plot.above, found.plant_error / np.cos(np.radians(plane.dip)))
    )
    return Grass(bias, error, known.sum() / len(np.unique(key)))


@pytest.fixture(scope="module")
def plots() -> dict[tuple[str, float], Grass]:
    return {(state, slope): grass_cells(state, slope) for state in ("grown", "mown") for slope in (10.0, 39.0)}


@pytest.mark.parametrize(("state", "slope"), [("grown", 10.0), ("grown", 39.0), ("mown", 10.0), ("mown", 39.0)])
def test_ground_under_grass_is_within_centimetres(plots, state, slope):
    found = plots[state, slope]
    # mown grass on the steep slope leaves nothing that lies deeper than its stubble
    assert abs(found.bias.mean()) <= (0.03 if (state, slope) == ("mown", 39.0) else 0.02)
    assert np.abs(found.bias).mean() <= 0.03
    assert found.share > 0.85


@pytest.mark.parametrize("seed", [4, 6])
def test_stubble_all_over_is_not_a_noisy_sensor(seed):
    """Half of the windows of such a cloud look like bare ground in 3 cm of noise."""
    plot = grass_plot(seed, side=10.0, density=700.0, state="mown", slope=10.0)
    found = known_ground(plot.cloud.xyz)
    assert np.mean(plot.above[found.mask]) < 0.025
    assert np.mean(found.plants.error > 0) > 0.5


def test_grass_holds_no_sheet_that_is_taken_for_bare_ground(plots):
    """Errors of 20 cm, stated as 0, came from windows in which a dozen returns of the grass lay on one plane."""
    found = plots["grown", 39.0]
    assert np.quantile(np.abs(found.bias), 0.99) < 0.1
    assert not (np.abs(found.bias[found.error == 0]) > 0.1).any()


def test_the_error_by_grass_is_what_is_stated(plots):
    bias, error = (np.concatenate([getattr(p, name) for p in plots.values()]) for name in ("bias", "error"))
    stated = error > 0
    assert stated.mean() > 0.8
    beyond = np.abs(bias[stated]) > 1.96 * error[stated]
    assert 0.01 <= beyond.mean() <= 0.12


def residuals(reference: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Heights of points over planes through the eight nearest points of a reference, m."""
    _, nearest = cKDTree(reference[:, :2]).query(points[:, :2], k=8)
    around = reference[nearest]
    middle = around.mean(axis=1)
    local = around - middle[:, None]
    matrix = np.einsum("nki,nkj->nij", local[..., :2], local[..., :2]) + 1e-6 * np.eye(2)
    grade = np.linalg.solve(matrix, np.einsum("nki,nk->ni", local[..., :2], local[..., 2])[..., None])[..., 0]
    return points[:, 2] - middle[:, 2] - ((points[:, :2] - middle[:, :2]) * grade).sum(axis=1)


def forest(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals of the ground over the vendor's, and which points are ground of either."""
    las = laspy.read(folder / "terrain" / f"{name}.laz")
    xyz, vendor = np.array(las.xyz), np.asarray(las.classification) == 2
    found = ground_mask(xyz, last=np.asarray(las.return_number) >= np.asarray(las.number_of_returns))
    return residuals(xyz[vendor], xyz[found]), found, vendor


def test_ground_of_an_alpine_forest_is_the_vendors(shared_data):
    above, found, vendor = forest(shared_data, "chablais_forest")
    assert abs(above.mean()) <= 0.05
    assert np.quantile(above, 0.99) <= 0.30
    assert (found & vendor).sum() / vendor.sum() >= 0.88


def test_ground_of_a_closed_rain_forest_lies_near_the_vendors(shared_data):
    above, found, _ = forest(shared_data, "coromandel_forest")
    assert found.sum() > 1000
    assert abs(above.mean()) <= 0.40
