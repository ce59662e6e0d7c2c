"""Simulated series: the laws of motion, and surveys whose ground has moved by them."""

from __future__ import annotations

import json
from datetime import date

import laspy
import numpy as np
import pytest
from slopewatch.engine.grid.cell_statistics import cell_statistics
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.change import Bump, Cone, Plateau, Slump
from slopewatch.simulation.surveys.series import (
    Creep,
    Fukuzono,
    Motion,
    Settling,
    simulate_series,
    survey_days,
    write_series,
)


def velocity(law, days: float) -> float:
    return (law.displacement(days + 1e-4) - law.displacement(days - 1e-4)) / 2e-4


def test_laws_have_their_velocities():
    assert Creep(0.01, 20.0).displacement(20.0) == 0
    assert velocity(Creep(0.01, 20.0), 50.0) == pytest.approx(0.01)
    settling = Settling(-0.4, 30.0)
    assert settling.displacement(1e4) == pytest.approx(-0.4)
    assert velocity(settling, 30.0) / velocity(settling, 1.0) == pytest.approx(np.exp(-29 / 30))
    law = Fukuzono(-0.2, 110.0)
    for t in (1.0, 60.0, 100.0):
        assert 1 / velocity(law, t) == pytest.approx(-(110 - t) / 0.2, rel=1e-5)


@pytest.mark.parametrize(
    "shape", [Bump(0, 0, 2.0, 1.6, 1.0), Cone(0, 0, 4.0, 1.0), Plateau(0, 0, 3.0, 1.0), Slump(0, 0, 1.8, 5.6, 1.0)]
)
def test_shapes_of_every_kind_move_by_their_law(shape):
    moving = Motion(shape, Creep(0.01, 20.0))
    u, v = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-3, 3, 13))
    np.testing.assert_allclose(moving.at(50.0).dz(u, v), 0.3 * shape.dz(u, v), atol=1e-12)
    assert not moving.at(10.0).dz(u, v).any()


def test_survey_days_are_evenly_apart():
    assert survey_days(3, 31, date(2024, 1, 1)) == (date(2024, 1, 1), date(2024, 2, 1), date(2024, 3, 3))


@pytest.fixture(scope="module")
def series():
    parameters = SurveyParameters(seed=2, points=20_000, length=14.0, height=6.0, vegetation=0.0, offset=0.1)
    return simulate_series(parameters, survey_days(3, 40), (Creep(-0.008, 40.0), Creep(0.004)))


def test_surveys_show_the_true_change_once_their_offset_is_undone(series):
    first = series.clouds[0].xyz
    grid = snapped_grid((*first[:, :2].min(axis=0), *first[:, :2].max(axis=0)), 0.5)

    def heights(points):
        cells = cell_statistics(points, grid, plane=True)
        return cells.on_grid(cells.height)

    before = heights(first)
    for number in (1, 2):
        moved = series.transforms[number].apply(series.clouds[number].xyz)
        dz = heights(moved) - before
        truth = series.true_change(number, grid)
        for sign in (-1, 1):
            there = (truth * sign > 0.05) & np.isfinite(dz)
            assert bool(there.any()) == (sign > 0 or number == 2)  # the lowering begins with the second survey
            if there.any():
                assert np.median((dz - truth)[there]) == pytest.approx(0, abs=0.01)
        # no offset left, and none alike
        assert abs(np.nanmedian((dz - truth)[np.abs(truth) < 1e-6])) < 0.004
    offsets = [np.linalg.norm(t.translation) for t in series.transforms]
    assert offsets == pytest.approx([0.0, 0.1, 0.1])
    assert not np.allclose(series.transforms[1].translation, series.transforms[2].translation)


def test_true_velocity_is_the_rate_times_the_shape(series):
    grid = snapped_grid((*series.roi.min(axis=0), *series.roi.max(axis=0)), 0.5)
    change = series.true_change(2, grid)
    velocities = [series.true_velocity(k, grid) for k in range(2)]
    np.testing.assert_allclose(velocities[0] * 40 + velocities[1] * 80, change, atol=1e-6)


def test_written_series_is_dated_and_tells_the_truth(series, tmp_path):
    paths = write_series(series, tmp_path, ground_only=True)
    assert sorted(p.name for p in tmp_path.glob("*.laz")) == ["2024-05-01.laz", "2024-06-10.laz", "2024-07-20.laz"]
    las = laspy.read(paths["2024-06-10"])
    assert len(las.points) == int(series.clouds[1].truth_ground.sum())
    assert las.header.creation_date == date(2024, 6, 10)
    truth = json.loads(paths["truth"].read_text())
    assert truth["motions"][0]["displacement_m"] == [0.0, 0.0, pytest.approx(-0.32)]
    again = simulate_series(series.parameters, series.dates, [m.law for m in series.motions])
    np.testing.assert_array_equal(again.clouds[2].xyz, series.clouds[2].xyz)
