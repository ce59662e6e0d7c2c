"""Pairs of surveys: what is known of them holds."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
import shapely
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.change import Cone, Plateau
from slopewatch.simulation.surveys.scanner import SurveyCloud
from slopewatch.simulation.surveys.survey import ROI_SHARE, simulate_controlled_test, simulate_pair
from slopewatch.tests.simulation.conftest import SMALL


def share_in_roi(pair, cloud: SurveyCloud) -> float:
    return float(shapely.contains_xy(shapely.Polygon(pair.roi), cloud.xyz[:, 0], cloud.xyz[:, 1]).mean())


def test_number_of_points_and_their_share_in_the_roi(pair):
    for cloud in (pair.first, pair.second):
        assert len(cloud) == pytest.approx(SMALL.points, rel=0.1)
    assert share_in_roi(pair, pair.first) == pytest.approx(ROI_SHARE, abs=0.02)


def test_transform_takes_the_second_epoch_back_onto_the_changed_ground(pair):
    ground = pair.second.truth_ground == 1
    as_flown = pair.second.xyz[ground]
    back = pair.transform.apply(as_flown)
    residual = back[:, 2] - pair.scene.height_at(back)
    untouched = as_flown[:, 2] - pair.scene.height_at(as_flown)
    # Range noise of 2 cm on a slope of 39 degrees, grass up to 3 cm.
    assert np.abs(np.median(residual)) < 0.005
    assert residual.std() < 0.03
    assert np.abs(np.median(untouched)) > 0.02
    assert np.linalg.norm(back - as_flown, axis=1).mean() == pytest.approx(SMALL.offset, abs=0.01)
    homogeneous = np.column_stack([as_flown, np.ones(len(as_flown))])
    assert np.abs((homogeneous @ pair.transform.matrix.T)[:, :3] - back).max() < 1e-6


def test_first_epoch_is_the_ground_without_the_changes(pair):
    ground = pair.first.xyz[pair.first.truth_ground == 1]
    before = ground[:, 2] - pair.scene.with_changes(()).height_at(ground)
    after = ground[:, 2] - pair.scene.height_at(ground)
    assert np.abs(before).max() < 0.15
    assert np.abs(after).max() > 0.2


def test_changes_lie_on_the_slope_apart_and_leave_most_of_it_stable(pair):
    u0, v0, u1, v1 = pair.scene.slope
    u, v = np.meshgrid(np.linspace(u0, u1, 500), np.linspace(v0, v1, 400))
    parts = [np.abs(change.dz(u, v)) > 1e-4 for change in pair.changes]
    assert len(parts) == 3
    assert np.sum(parts, axis=0).max() == 1
    assert 0.02 < np.any(parts, axis=0).mean() < 0.3
    for change in pair.changes:
        west, south, east, north = change.bounds
        assert u0 < west < east < u1
        assert v0 < south < north < v1
    largest = max(np.abs(change.dz(u, v)).max() for change in pair.changes)
    assert largest == pytest.approx(SMALL.amplitude, rel=0.02)


def test_same_seed_same_pair_other_seed_other_pair(pair):
    again = simulate_pair(SMALL)
    for one, two in ((pair.first, again.first), (pair.second, again.second)):
        for field in fields(SurveyCloud):
            assert np.array_equal(getattr(one, field.name), getattr(two, field.name)), field.name
    assert np.array_equal(pair.transform.matrix, again.transform.matrix)
    other = simulate_pair(SurveyParameters(seed=8, points=5000, length=24.0, height=10.0))
    assert other.changes != pair.changes
    assert not np.allclose(other.transform.translation, pair.transform.translation)


def test_epochs_do_not_see_the_same_places(pair):
    """Pulses of the two epochs fall differently: nearest ground points are as far as in two independent samples."""
    from scipy.spatial import cKDTree

    first = pair.first.xyz[pair.first.truth_ground == 1]
    second = pair.transform.apply(pair.second.xyz)[pair.second.truth_ground == 1]
    distance, _ = cKDTree(first[:, :2]).query(second[:, :2])
    within, _ = cKDTree(first[:, :2]).query(first[:, :2], k=2)
    assert np.median(distance) == pytest.approx(np.median(within[:, 1]), rel=0.2)


@pytest.mark.parametrize(
    ("angle", "height", "length", "benches", "vegetation"),
    [(5.0, 2.0, 8.0, 0, 0.0), (63.0, 24.0, 15.0, 3, 0.4), (75.0, 10.0, 10.0, 0, 0.98)],
)
def test_other_slopes(angle, height, length, benches, vegetation):
    parameters = SurveyParameters(
        points=8000, length=length, height=height, angle=angle, benches=benches, vegetation=vegetation, amplitude=0.0
    )
    pair = simulate_pair(parameters)
    assert pair.changes == ()
    assert len(pair.first) == pytest.approx(8000, rel=0.1)
    u0, v0, u1, v1 = pair.scene.slope
    assert pair.scene.profile(np.array([v1]))[0] == pytest.approx(height - benches * 0.06)
    xyz = pair.first.xyz[pair.first.truth_ground == 1]
    assert len(xyz) > 100
    # Noise along the beam shows as tan(angle) times as much in height.
    residual = xyz[:, 2] - pair.scene.height_at(xyz)
    assert np.median(np.abs(residual)) < 0.02 * (1 + np.tan(np.radians(angle)))
    assert pair.canopy.cover((u0, max(v0, 0.5), u1, v1)) == pytest.approx(vegetation, abs=0.04)


def test_steep_face_is_seen():
    """The face of 63 degrees between berms gets ground points at every height, though lines pass overhead."""
    pair = simulate_pair(
        SurveyParameters(points=30_000, length=15.0, height=24.0, angle=63.0, benches=2, vegetation=0.0)
    )
    local = pair.scene.frame.to_local(pair.first.xyz)
    inside = (local[:, 0] > 0) & (local[:, 0] < 15.0)
    counts, _ = np.histogram(local[inside, 2], np.arange(1.0, 23.0))
    assert counts.min() > 30


def test_controlled_test_has_the_published_bodies():
    pair = simulate_controlled_test(seed=3, density=60.0, offset=0.0)
    plateau, cone = pair.changes
    assert isinstance(plateau, Plateau)
    assert isinstance(cone, Cone)
    assert (plateau.side, plateau.height) == (1.0, 0.16)
    assert (cone.diameter, cone.peak) == (1.06, 0.36)
    assert np.array_equal(pair.transform.matrix, np.eye(4))
    area = shapely.Polygon(pair.roi).area
    assert area == pytest.approx(400.0)
    assert share_in_roi(pair, pair.first) * len(pair.first) / area == pytest.approx(60.0, rel=0.1)
    assert pair.canopy.cover((0.0, 0.5, 20.0, 20.0)) == pytest.approx(0.6, abs=0.03)
    shifted = simulate_controlled_test(seed=4, density=30.0, offset=0.05)
    assert np.linalg.norm(shifted.transform.translation) == pytest.approx(0.05)
    assert shifted.changes != pair.changes


def test_progress_rises_to_the_end():
    class Recorder(Progress):
        def __init__(self) -> None:
            super().__init__()
            self.percents: list[float] = []

        def emit(self, percent: float, message: str) -> None:
            self.percents.append(percent)

    recorder = Recorder()
    simulate_pair(SurveyParameters(points=2000, length=10.0, height=4.0), recorder)
    assert np.diff(recorder.percents).min() > -1e-9
    assert recorder.percents[0] == 0.0
    assert recorder.percents[-1] == pytest.approx(100.0)
    assert len(recorder.percents) > 8
