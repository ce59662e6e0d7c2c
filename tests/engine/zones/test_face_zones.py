"""Zones of faces that changed by known volumes, up to the vertical."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from slopewatch.engine.m3c2.distances import Cylinder, Distances, LevelTerms, m3c2_distances
from slopewatch.engine.m3c2.lattice import Lattice
from slopewatch.engine.m3c2.level import calibrated
from slopewatch.engine.m3c2.normals import fit_planes
from slopewatch.engine.zones.face_zones import Areas, FaceCells, FaceZones, face_zones

SIDE_M, RADIUS_M, SPACING_M, ERROR_M = 16.0, 0.3, 0.25, 0.003
CHANGES = ((4.0, 4.0, 2.0, 0.08), (11.0, 5.0, 2.0, -0.08), (5.0, 11.5, 2.5, 0.15), (11.5, 11.5, 1.5, -0.2))
"""Place along and up the face, radius and height of a cosine bump, m."""


def survey(seed: int, dip: float, changes=(), density: float = 100.0, rocks_m: float = 0.06):
    """Points (n, 3) of a rough face, which rocks of so many metres cover, and its normal."""
    rng = np.random.default_rng(seed)
    rocks = gaussian_filter(np.random.default_rng(7).normal(size=(160, 160)), 4)
    along, up = rng.uniform(0, SIDE_M, (2, int(density * SIDE_M**2)))
    out = map_coordinates(rocks_m * rocks / rocks.std(), [10 * along, 10 * up], order=1, mode="nearest")
    out += rng.normal(0, 0.01, len(along))
    for east, high, radius, height in changes:
        share = np.hypot(along - east, up - high) / radius
        out += np.where(share < 1, height * np.cos(0.5 * np.pi * share) ** 2, 0.0)
    angle = np.radians(dip)
    normal = np.array([0.0, -np.sin(angle), np.cos(angle)])
    return np.column_stack([along, up * np.cos(angle), up * np.sin(angle)]) + out[:, None] * normal, normal


def volume_of(change: tuple[float, float, float, float]) -> float:
    """Of a cosine bump, m³: the integral of h cos²(pi r / 2 R) over its disc."""
    *_, radius, height = change
    return height * np.pi * radius**2 * (0.5 - 2 / np.pi**2)


def measured(seed: int, dip: float, changes=(), behind: float = 0.0, rocks_m: float = 0.06) -> Distances:
    """Of a face that stands once more, 5 m farther back, over the first ``behind`` metres along it."""
    first, second = (survey(seed + k, dip, of, rocks_m=rocks_m)[0] for k, of in ((0, ()), (1, changes)))
    back = 5.0 * survey(seed, dip)[1]
    first, second = (np.concatenate([xyz, xyz[xyz[:, 0] < behind] - back]) for xyz in (first, second))
    core = first[:: round(100.0 * SPACING_M**2)]
    normal = fit_planes(Lattice(first, 0.4), core, 0.8).normal
    clouds = Lattice(first, RADIUS_M), Lattice(second, RADIUS_M)
    terms = LevelTerms(registration_error=ERROR_M)
    found = m3c2_distances(clouds, core, normal, Cylinder(RADIUS_M, 0.5), terms, spread=True)
    return calibrated(found, RADIUS_M)


def zones_of(seed: int, dip: float, changes=()) -> FaceZones:
    return face_zones(measured(seed, dip, changes), SPACING_M, None)


@pytest.mark.parametrize("dip", [30.0, 65.0, 90.0])
def test_each_change_of_a_face_is_a_zone_whose_range_holds_its_volume(dip):
    found = zones_of(int(dip), dip, CHANGES).zones.frame
    assert len(found) == len(CHANGES)
    known = np.array([volume_of(change) for change in CHANGES])
    sign = np.sign(found["vol_net_m3"].sum()) * np.sign(known.sum())  # a vertical face has no upper side
    for low, high in zip(found["vol_low_m3"], found["vol_high_m3"], strict=True):
        assert ((sign * known >= low) & (sign * known <= high)).sum() >= 1
    assert np.abs(found["vol_net_m3"]).sum() == pytest.approx(np.abs(known).sum(), rel=0.05)
    assert np.allclose(found["slope_deg"].astype(float), dip, atol=8.0)


@pytest.mark.parametrize("rocks_m", [0.0, 0.15])
def test_volumes_are_right_where_normals_are_noisy_and_the_face_is_curved(rocks_m):
    """Steep flanks of rocks tilt the normals, and what lies on a bulge is wider than the bulge."""
    changes = tuple((*place, 0.3 * np.sign(height)) for *place, height in CHANGES)
    cells = FaceCells.of(measured(5, 75.0, changes, rocks_m=rocks_m), SPACING_M)
    volume = np.nan_to_num(cells.distance * cells.area)
    for sign in (-1.0, 1.0):
        moved = sum(abs(volume_of(change)) for change in changes if change[3] * sign > 0)
        found = sum(abs(volume[near(cells, change)].sum()) for change in changes if change[3] * sign > 0)
        assert found == pytest.approx(moved, rel=0.02)


def places(side: float, cell: float, seed: int = 0) -> np.ndarray:
    """Points (n, 2) of a square around 0, about one a cell."""
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (round((side / cell) ** 2), 2))


def test_noise_of_normals_makes_distances_longer_and_no_volume_larger():
    """Of two parallel planes, between which a distance along a tilted normal is the longer by its cosine."""
    local = np.column_stack([places(60.0, 1.0), np.zeros(3600)])
    normals = np.column_stack([np.random.default_rng(1).normal(0.0, 0.2, (3600, 2)), np.ones(3600)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    distance = 0.3 / normals[:, 2]
    areas = Areas.of(local, normals, np.zeros(3600), distance, 1.0)
    assert (distance * areas.acted_on).sum() == pytest.approx(0.3 * areas.in_plane.sum(), rel=0.01)
    assert (distance * areas.in_plane / normals[:, 2]).sum() > 1.07 * 0.3 * areas.in_plane.sum()


def test_rocks_whose_normals_cross_have_the_volume_between_the_surfaces():
    """Waves as tight as the layer on them is thick; the truth is the layer's height over the plane times the area."""
    length, rise, height = 1.0, 0.12, 0.3
    place = places(12.0, 0.05)
    turn = 2 * np.pi / length
    depth = rise * np.cos(turn * place[:, 0])
    slope = -rise * turn * np.sin(turn * place[:, 0])
    normal = np.column_stack([-slope, np.zeros(len(place)), np.ones(len(place))])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert height > 1 / (rise * turn**2), "beyond the radius of the waves, where their normals cross"
    # along each normal to the wave that stands higher, by Newton's method
    distance = height * normal[:, 2]
    for _ in range(50):
        along = place[:, 0] + distance * normal[:, 0]
        above = depth + distance * normal[:, 2] - height - rise * np.cos(turn * along)
        distance -= 0.5 * above / (normal[:, 2] + rise * turn * np.sin(turn * along) * normal[:, 0])
    assert np.abs(above).max() < 1e-3
    local = np.column_stack([place, depth])
    areas = Areas.of(local, normal, np.zeros(len(place)), distance, 0.05)
    inner = np.abs(place).max(axis=1) < 5.0  # ten whole waves
    assert (distance * areas.acted_on)[inner].sum() == pytest.approx(height * 100.0, rel=0.01)


@pytest.mark.parametrize("bulges", [1.0, -1.0])
def test_a_layer_on_a_bulge_holds_more_than_one_in_a_hollow(bulges):
    """Between spheres of 5 and 5.3 m, or of 5 and 4.7 m, over a square of the inner half."""
    radius, cell, height = 5.0, 0.1, 0.3
    place = places(5.0, cell)
    depth = np.sqrt(radius**2 - (place**2).sum(axis=1))
    normal = np.column_stack([bulges * place, depth]) / radius
    local = np.column_stack([place, bulges * depth])
    full = np.full(len(place), height)
    areas = Areas.of(local, normal, np.zeros(len(place)), full, cell)
    plain = Areas.of(local, normal, np.zeros(len(place)), 0.0 * full, cell)
    of_the_sphere = plain.acted_on.sum()
    layer = bulges * ((radius + bulges * height) ** 3 - radius**3) / (3 * radius**2)
    assert (height * areas.acted_on).sum() == pytest.approx(layer * of_the_sphere, rel=0.003)
    known = areas.in_plane * radius / depth
    assert of_the_sphere == pytest.approx(known.sum(), rel=0.01)


def near(cells: FaceCells, change: tuple[float, float, float, float]) -> np.ndarray:
    """Cells (rows, columns) up to a cylinder beyond a change."""
    row, column = np.indices(cells.grid.shape)
    along = cells.grid.west + (column + 0.5) * cells.grid.cell + SIDE_M / 2
    up = cells.grid.north - (row + 0.5) * cells.grid.cell + SIDE_M / 2
    return np.hypot(along - change[0], up - change[1]) < change[2] + 2 * RADIUS_M


def test_a_face_that_did_not_change_has_no_zone_and_hardly_a_cell_that_counts():
    for seed in range(3):
        found = zones_of(100 + 10 * seed, 60.0)
        assert len(found.zones.frame) == 0
        assert found.significant.mean() < 0.001


def test_one_in_twenty_of_the_cells_that_count_is_unchanged_at_most():
    """Of all unchanged cells one in fifty is beyond its level here; of those that count few are unchanged."""
    normal = survey(0, 60.0)[1]
    false, counted, beyond = 0, 0, 0
    for seed in (200, 210, 220):
        cells = FaceCells.of(measured(seed, 60.0, CHANGES), SPACING_M)
        row, column = np.indices(cells.grid.shape)
        west, north = cells.grid.west, cells.grid.north
        plane = np.stack([west + (column + 0.5) * SPACING_M, north - (row + 0.5) * SPACING_M], axis=-1)
        xyz = plane @ cells.face.axes[:2] + cells.face.origin
        place = np.stack([xyz[..., 0], xyz @ np.cross(normal, [1.0, 0.0, 0.0])], axis=-1)
        unchanged = np.all([c[2] + 2 * RADIUS_M < np.hypot(*(place - c[:2]).T).T for c in CHANGES], axis=0)
        significant = cells.discoveries(0.95)
        false += np.count_nonzero(significant & unchanged)
        counted += np.count_nonzero(significant)
        with np.errstate(invalid="ignore"):
            beyond += np.count_nonzero(unchanged & (np.abs(cells.distance) > 1.96 * cells.error))
    assert false <= 0.05 * counted
    assert beyond > 3 * false


def test_how_much_of_the_cells_on_the_edge_was_seen_is_in_the_error_of_a_zone_there_alone():
    bumps = [(0.0, 8.0, 2.5, 0.15), (9.0, 8.0, 2.5, 0.15)]  # the edge cuts the first in two
    found = zones_of(300, 65.0, bumps)
    frame = found.zones.frame.sort_values("vol_net_m3")
    assert len(frame) == 2
    # the section of a cosine bump is height times radius
    expected = 0.15 * 2.5 * SPACING_M / np.sqrt(12.0)
    middle = len(found.cells.dz) // 2
    near = np.s_[middle - 12 : middle + 12, :4]
    assert np.nansum(found.cells.shared[near] * found.cells.area[near]) == pytest.approx(expected, rel=0.3)
    assert frame["vol_err_m3"].iloc[0] > 0.7 * expected
    row, column = np.nonzero(found.cells.shared)
    low, high = np.array([row, column]), np.array(found.cells.dz.shape)[:, None]
    assert np.minimum(low, high - 1 - low).min(axis=0).max() <= 2, "only along the edge, not around gaps"


def test_parts_of_a_face_that_lie_behind_one_another_are_left_out_and_the_share_is_known():
    """Their mean would be half the change of one of them; the changes of the other half are found as without them."""
    found = face_zones(measured(65, 65.0, CHANGES, behind=8.0), SPACING_M, None)
    # the plane through both is turned against the face, so that a part of the one behind is seen beside it
    beside = 5.0 * abs(survey(0, 65.0)[1] @ found.face.face.axes[0])
    assert 0.0 < beside < 2.0
    twice = 2 * (8.0 - beside) / (SIDE_M + 8.0)
    assert found.face.left_out == pytest.approx(twice, abs=0.04)
    assert sorted(np.sign(found.zones.frame["vol_net_m3"])) == [-1.0, -1.0]
    known = sum(volume_of(change) for change in CHANGES if change[0] > 8.0)
    assert found.zones.frame["vol_net_m3"].sum() == pytest.approx(known, rel=0.05)
    assert zones_of(65, 65.0, CHANGES).face.left_out < 0.01


def test_polygons_of_a_wall_stay_polygons_on_the_map():
    """Seen from above, parts of a wall's outlines are lines."""
    found = zones_of(90, 90.0, CHANGES)
    for frame in (found.zones.frame, found.footprints, found.zones.unsure):
        assert set(frame.geometry.geom_type) <= {"MultiPolygon"}
        assert frame.geometry.is_valid.all()
    assert (found.footprints.geometry.area > 0).all()


def test_all_that_moved_alike_is_no_zone():
    first, normal = survey(1, 60.0)
    second = survey(2, 60.0)[0] + 0.2 * normal
    core = first[::25]
    clouds = Lattice(first, RADIUS_M), Lattice(second, RADIUS_M)
    axes = np.tile(normal, (len(core), 1))
    found = m3c2_distances(clouds, core, axes, Cylinder(RADIUS_M, 0.6), LevelTerms(registration_error=ERROR_M))
    assert found.significant[found.measured].mean() > 0.9
    assert len(face_zones(found, SPACING_M, None).zones.frame) == 0
