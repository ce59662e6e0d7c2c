"""Change along the slope's normal, given stable ground, and surveys without stable ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from slopewatch.engine.change.difference import Areas, difference
from slopewatch.engine.change.doubts import warn_of_doubtful_change
from slopewatch.engine.change.judgement import judge
from slopewatch.engine.change.measured import Measured
from slopewatch.engine.change.result import Change
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.partition import Partition
from slopewatch.interface.parameters import ChangeParameters

DIP = math.radians(60.0)
NORMAL = np.array([0.0, -math.sin(DIP), math.cos(DIP)])
WIDTH, RUN = 20.0, 12.0  # of the face, on the map


def face(seed: int, density: float = 300.0, noise: float = 0.01) -> np.ndarray:
    """Points of a face of 60 degrees with waves, evenly spread on the face, noise along the normal."""
    rng = np.random.default_rng(seed)
    count = round(density * WIDTH * RUN / math.cos(DIP))
    x, y = rng.uniform(0, WIDTH, count), rng.uniform(0, RUN, count)
    wave = 0.08 * np.sin(2 * np.pi * x / 5) * np.cos(2 * np.pi * y / 4)
    plane = np.column_stack([x, y, y * math.tan(DIP)])
    return plane + (wave + rng.normal(0, noise, count))[:, None] * NORMAL


def bulged(points: np.ndarray, distance: float) -> np.ndarray:
    """A patch of 8 by 4 m (on the map) of the face moved along its normal."""
    patch = (np.abs(points[:, 0] - 10) < 4) & (np.abs(points[:, 1] - 6) < 2)
    return points + distance * patch[:, None] * NORMAL


def core(change: Change) -> np.ndarray:
    """Cells well inside of the patch, wherever it moved to."""
    grid = change.grid
    row, column = np.indices(grid.shape)
    x = grid.west + (column + 0.5) * grid.cell
    y = grid.north - (row + 0.5) * grid.cell
    return (np.abs(x - 10) < 3.5) & (np.abs(y - 6) < 1.3) & change.valid


def test_a_known_distance_square_to_a_face_of_60_degrees():
    first, second = face(1), bulged(face(2), 0.12)
    normal = difference(first, second, ChangeParameters(cell=0.25, direction="normal"))
    vertical = difference(first, second, ChangeParameters(cell=0.25, direction="vertical"))
    inside = core(normal)
    assert np.median(normal.dz[inside]) == pytest.approx(0.12, abs=0.002)
    assert np.median(vertical.dz[inside]) == pytest.approx(0.12 / math.cos(DIP), abs=0.004)
    assert normal.median_level == pytest.approx(vertical.median_level * math.cos(DIP), rel=0.1)
    assert (normal.measure, vertical.measure) == ("Slope-normal change", "Elevation change")
    assert normal.level_facts()["direction"] == "normal"


def test_both_directions_have_the_same_volume():
    """A slab of 8 by 4 m on the map, twice as long on the face, 0.12 m thick."""
    first, second = face(3), bulged(face(4), 0.12)
    volumes = []
    for direction in ("normal", "vertical"):
        change = difference(first, second, ChangeParameters(cell=0.25, direction=direction))
        grid = change.grid
        near = np.abs(grid.west + (np.arange(grid.columns) + 0.5) * grid.cell - 10) < 5
        part = (change.dz * change.cell_area)[:, near]
        volumes.append(np.nansum(part))
    assert volumes == pytest.approx(2 * [0.12 * 8 * 4 / math.cos(DIP)], rel=0.05)


def test_a_sideways_shift_looks_smaller_along_the_normal():
    """3 cm towards the slope: 5.2 cm of height, 2.6 cm square to the face; along the strike nearly nothing."""
    first, second = face(5), face(6)
    for shift, expected in (((0.0, 0.03, 0.0), -0.03), ((0.03, 0.0, 0.0), 0.0)):
        moved = second + np.array(shift)
        vertical = difference(first, moved, ChangeParameters(cell=0.25, direction="vertical"))
        normal = difference(first, moved, ChangeParameters(cell=0.25, direction="normal"))
        assert np.nanmedian(vertical.dz) == pytest.approx(expected * math.tan(DIP), abs=0.004)
        assert np.nanmedian(normal.dz) == pytest.approx(expected * math.sin(DIP), abs=0.002)


def test_the_shared_part_of_the_error_is_along_the_normal_too():
    change = difference(
        face(1), face(2), ChangeParameters(cell=0.25, direction="normal", calibrate=False), registration_error=0.02
    )
    assert change.registration_error == pytest.approx(0.02 * math.cos(DIP), rel=0.05)
    assert np.nanmin(change.error) >= change.registration_error


def test_heights_of_two_systems_are_no_deformation():
    """Ellipsoidal against orthometric heights: 34.2 m, with the geoid's tilt of 3 cm over the slope."""
    first, second = face(1), face(2)
    second[:, 2] += 34.2 + 0.03 * second[:, 0] / WIDTH
    change = difference(first, second, ChangeParameters(cell=0.25))
    plain = difference(first, second, ChangeParameters(cell=0.25, calibrate=False))
    assert change.uniform_dz == pytest.approx(34.215, abs=0.01)
    assert not change.stable.any()
    assert np.array_equal(change.level, plain.level, equal_nan=True), "the bias must not hide in the errors"
    progress = Progress()
    warn_of_doubtful_change(change, progress)
    assert any("height systems" in warning for warning in progress.warnings)


@pytest.mark.parametrize("direction", ["vertical", "normal"])
def test_a_uniform_shift_is_told_whatever_the_direction(direction):
    second = face(2) + [0.0, 0.0, -0.15]
    change = difference(face(1), second, ChangeParameters(cell=0.25, direction=direction))
    assert change.uniform_dz == pytest.approx(-0.15, abs=0.005)


def test_little_compared_ground_comes_with_what_would_help_there():
    """Cells of 5 cm on some 60 points a square metre: hardly any holds points of both surveys."""
    change = difference(face(1)[::6], face(2)[::6], ChangeParameters(cell=0.05, calibrate=False, adaptive=False))
    said = {}
    for may_grow in (True, False):
        progress = Progress()
        warn_of_doubtful_change(change, progress, may_grow=may_grow)
        said[may_grow] = next(w for w in progress.warnings if "was seen by both surveys" in w)
    assert "cells that grow" in said[True]
    assert "cells that grow" not in said[False]
    assert said[False].endswith("would compare most of it.")


def test_without_stable_ground_the_level_is_wider_and_says_why():
    """Known stable ground that lies outside of what was surveyed."""
    elsewhere = shapely.box(100, 100, 120, 120)
    progress = Progress()
    change = difference(face(1), face(2), ChangeParameters(cell=0.25), areas=Areas(stable=elsewhere))
    plain = difference(face(1), face(2), ChangeParameters(cell=0.25, calibrate=False))
    assert change.model.kind == "widened"
    assert np.allclose((change.level / plain.level)[change.valid], 1.5)
    warn_of_doubtful_change(change, progress)
    assert any("could not be calibrated" in warning for warning in progress.warnings)


def test_known_stable_ground_decides_where_it_lies():
    """The known half scatters as its points do, the other half three times as much: it must not set the level."""
    first, second = face(1), face(2)
    rough = second[:, 0] > 10
    patch = np.floor(second[:, :2] / 0.25).astype(int)
    jitter = np.random.default_rng(3).normal(0, 0.03, (200, 100))
    second = second + (rough * jitter[patch[:, 0], patch[:, 1]])[:, None] * NORMAL
    given = difference(first, second, ChangeParameters(cell=0.25), areas=Areas(stable=shapely.box(0, 0, 10, 12)))
    found = difference(first, second, ChangeParameters(cell=0.25))
    grid = given.grid
    west = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell < 10
    here = given.valid & west
    assert 0.03 <= given.significant[here].mean() <= 0.07
    assert found.significant[here].mean() < 0.03
    assert given.stable[:, west].sum() > 0.8 * given.stable.sum()


def test_each_slope_of_grown_cells_is_calibrated_for_itself():
    """Blocks of 8 by 8 cells, 1,600 in all: half of them on a face whose errors are twice what the points say."""
    random = np.random.default_rng(3)
    block = np.arange(1600).reshape(40, 40).repeat(8, axis=0).repeat(8, axis=1)
    face = block % 40 >= 20
    slope = np.where(face, 52.0, 12.0)
    sampling = np.full(block.shape, 0.02)
    dz = (random.normal(0, 0.02, 1600))[block] * np.where(face, 2.0, 1.0)
    parameters, partition = ChangeParameters(cell=0.2), Partition.of_blocks(block, 0.2)
    found = judge(Measured(dz, sampling, slope, partition), parameters, registration_error=0.0)
    one = partition.one_each(np.ones(block.shape, dtype=bool))
    for where in (face, ~face):
        assert 0.03 <= found.decision.significant[one & where].mean() <= 0.07
    assert len(found.model.classes) == 2
    assert found.model.stable_share > 0.9, "of the blocks, not of their cells"


@pytest.mark.parametrize("share", [0.25, 0.5, 0.7])
@pytest.mark.parametrize("block_side", [1, 4])
def test_where_much_has_changed_the_level_stays_what_points_say(share, block_side):
    """A part of the slope sank by 20 cm, with errors of 2 cm as stated."""
    random = np.random.default_rng(8)
    number = np.arange(100 * 100 // block_side**2).reshape(100 // block_side, -1)
    block = number.repeat(block_side, axis=0).repeat(block_side, axis=1)
    column = np.indices((100, 100))[1]
    moved = column < 100 * share
    dz = random.normal(0, 0.02, number.size)[block] - 0.2 * moved
    sampling, slope = np.full(dz.shape, 0.02), np.full(dz.shape, 20.0)
    partition = Partition(dz.shape, 0.2) if block_side == 1 else Partition.of_blocks(block, 0.2)
    measured = Measured(dz, sampling, slope, partition)
    found = judge(measured, ChangeParameters(cell=0.2), registration_error=0.001)
    assert np.median(found.decision.level) == pytest.approx(1.96 * 0.02, rel=0.2), "not a multiple of it"
    assert found.decision.significant[moved].mean() > 0.95
    assert found.model.changed_share == pytest.approx(share, abs=0.06)
    told = found.model.kind == "uncalibrated"
    assert told == (share > 1 / 3) == ("known to be stable" in " ".join(found.model.notes))
    assert not found.stable[moved].mean() > 0.05
    assert found.model.summary()["changed_share"] == found.model.changed_share
