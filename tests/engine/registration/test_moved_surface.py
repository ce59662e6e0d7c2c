"""Where much of a surface moved: which registration is kept, what is refused, and that the error covers the rest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.registration import moved_surface
from slopewatch.engine.registration.alignment import Alignment
from slopewatch.engine.registration.measured import Measured, of_alignment
from slopewatch.engine.registration.moved_surface import _chosen, _kept, _require_expected
from slopewatch.engine.registration.observability import Information
from slopewatch.engine.registration.patch_agreement import PatchAgreement, patch_agreement
from slopewatch.engine.registration.patch_registration import OnPatches
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.quality import agreement
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.rival_parts import standing
from slopewatch.engine.registration.surface import Surface
from slopewatch.engine.registration.surface_patches import cut
from slopewatch.interface.parameters import InputParameters, RegistrationParameters

from .test_rival_parts import BLOCK, EAST, RING, WEST, part

SIDE = 12.0


def ground(seed: int) -> np.ndarray:
    """Waves in both directions with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, 15_000))
    z = 0.4 * np.sin(1.3 * x) * np.cos(0.9 * y) + 0.2 * np.sin(0.8 * x + 2.1 * y)
    return np.column_stack([x, y, z + rng.normal(0, 0.01, x.size)]) - [SIDE / 2, SIDE / 2, 0.0]


def test_what_left_the_reach_of_the_comparison_counts_as_moved():
    """A third rose by 3 m, beyond the largest offset: it has no counterpart, but lies over the reference."""
    later = ground(2)
    rose = later[:, 0] < -SIDE / 6
    later[rose, 2] += 3.0
    matcher = Matcher(Surface(ground(1), 0.1), Surface(later, 0.1))
    assert agreement(matcher, Pose.identity(), 1.0).stable_share == pytest.approx(1 - rose.mean(), abs=0.05)
    seen = patch_agreement(matcher, cut(matcher.moving, 3 * matcher.noise), Pose.identity())
    assert seen.share == pytest.approx(1 - rose.mean(), abs=0.08)
    # what only one survey saw has not moved
    beside = Matcher(Surface(ground(1)[ground(1)[:, 0] > -SIDE / 6], 0.1), Surface(ground(2), 0.1))
    assert patch_agreement(beside, cut(beside.moving, 3 * beside.noise), Pose.identity()).share > 0.95
    assert agreement(beside, Pose.identity(), 1.0).stable_share > 0.9


@pytest.mark.parametrize(("share", "shift", "refused"), [(0.45, 1.6, True), (0.45, 0.6, False), (0.80, 1.6, False)])
def test_a_part_beyond_the_largest_offset_is_no_stable_ground(share, shift, refused):
    """It may be what moved: only where nearly everything agrees are the surveys off by so much."""
    judged = standing(part(share, shift, WEST, part(0.05, 0.1, EAST)), 5.0)
    assert judged.known
    if not refused:
        _require_expected(judged, RegistrationParameters())
        return
    with pytest.raises(InputError, match="maximum-offset"):
        _require_expected(judged, RegistrationParameters())
    _require_expected(judged, RegistrationParameters(maximum_offset=2.0))
    _require_expected(judged, RegistrationParameters(accept_unstable=True))
    with pytest.raises(InputError, match="maximum-offset"):  # without any other part, too
        _require_expected(standing(part(share, shift, WEST), 5.0), RegistrationParameters())


def by(shift: float, sd: float, fixed: int = 6) -> Alignment:
    """An alignment that shifts along x, of which the first ``fixed`` motions are known to ``sd``, others to 1 m."""
    known = np.arange(6) < fixed
    information = Information(np.ones(6), np.eye(6), known, np.diag(np.where(known, sd, 1.0) ** 2))
    return Alignment(Pose(np.eye(3), np.array([shift, 0.0, 0.0])), 0.01, 5.0, 1, True, information)


@pytest.mark.parametrize(
    ("agree", "all_ground", "on_part", "kept", "sd"),
    [
        (0.85, by(0.0, 0.002), by(0.002, 0.003), True, 0.002),  # one motion: the surer one, as it is
        (0.85, by(0.0, 0.004), by(0.002, 0.003), False, 0.0),
        (0.85, by(0.0, 0.002), by(0.030, 0.003), True, 0.030),  # two: the error covers the other
        (0.60, by(0.0, 0.002), by(0.030, 0.003), False, 0.0),  # much moved
        (0.60, by(0.0, 0.020), by(0.030, 0.020, 4), True, 0.020),  # rough ground, of which the part fixes less
        (0.49, by(0.0, 0.002), by(0.400, 0.003, 3), True, 0.002),  # the part fixes less, and holds less
        (0.42, by(0.0, 0.002), by(0.400, 0.003, 3), False, 0.0),
        (0.42, by(0.0, 0.002), by(0.002, 0.003), False, 0.0),  # most disagrees
        (0.85, by(0.0, 0.002, 5), by(0.002, 0.003), False, 0.0),  # the part fixes more
    ],
)
def test_the_registration_by_all_ground_is_kept_where_it_is_surer(agree, all_ground, on_part, kept, sd):
    places = np.random.default_rng(0).uniform(-5, 5, (50, 3))
    normals = np.tile([0.0, 0.0, 1.0], (50, 1))
    found = Measured(of_alignment(all_ground), SimpleNamespace(places=places, normals=normals), 0.002, 0.0)
    judged = standing(part(0.45, 0.1, WEST), 5.0)
    area = np.ones(400)
    agrees = np.argsort(~WEST, kind="stable")[: round(400 * agree)]
    seen = PatchAgreement(area, np.isin(np.arange(400), agrees), area > 0, area < 0)
    assert seen.share == pytest.approx(agree, abs=0.01)
    result = _kept(found, all_ground, seen, OnPatches(on_part, judged, None, WEST))
    assert (result is not None) is kept
    if result is not None:
        assert np.sqrt(result.solution.information.covariance[3, 3]) == pytest.approx(sd, rel=0.05)


@pytest.mark.parametrize(("shares", "sd"), [((0.45, 0.40), 0.10), ((0.60, 0.24), 0.002), ((0.50, 0.45), None)])
def test_parts_within_the_scatter_are_covered_only_if_they_are_alike(monkeypatch, shares, sd):
    """Parts at 0.05 and 0.20 m, all ground at 0.10 m with a scatter of 0.09 m: a small other part is scatter.

    Two parts that leave nothing aside are a step, which is larger than their own noise of 0.01 m: refused.
    """
    judged = standing(part(shares[0], 0.05, BLOCK, part(shares[1], 0.20, RING)), 5.0)
    assert judged.contested
    quality = SimpleNamespace(places=np.zeros((50, 3)), normals=np.tile([0.0, 0.0, 1.0], (50, 1)), scale=0.09)
    quality.stable_share = 0.99
    all_ground = by(0.10, 0.002)
    found = Measured(of_alignment(all_ground), quality, 0.002, 0.0)
    monkeypatch.setattr(moved_surface, "patch_agreement", lambda *_: SimpleNamespace(judged=1.0, share=0.5))
    monkeypatch.setattr(
        moved_surface, "align_on_patches", lambda *_: SimpleNamespace(standing=judged, alignment=all_ground)
    )
    monkeypatch.setattr(moved_surface, "measured", lambda *_, **__: found)
    monkeypatch.setattr(moved_surface, "_kept", lambda *_: found)
    if sd is None:
        with pytest.raises(InputError, match="--stable"):
            _chosen(found, all_ground, None, None, RegistrationParameters(), Progress())
        return
    result = _chosen(found, all_ground, None, None, RegistrationParameters(), Progress())
    assert np.sqrt(result.solution.information.covariance[3, 3]) == pytest.approx(sd, rel=0.01)


def published(shared_data, epoch: str, every: int, *, truth: bool = False) -> np.ndarray:
    folder = shared_data / "unstable_series" / ("truth" if truth else "")
    return read_cloud(folder / f"2024-01-{epoch}.laz", InputParameters(crs="EPSG:32632")).xyz[::every]


def test_a_published_survey_of_which_half_moved_is_registered(shared_data):
    """Twenty times life-size: 0.02 m are 1 mm. One wall alone fixes the turn about the vertical."""
    reference, later = published(shared_data, "01", 3), published(shared_data, "07", 3)
    found = register(reference, later, RegistrationParameters())
    truth = published(shared_data, "07", 3, truth=True)
    still = cKDTree(published(shared_data, "01", 1, truth=True)).query(truth)[0] < 0.08
    away = found.transform.apply(later[still]) - truth[still]
    error = float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    assert error < 0.02
    assert found.covariance is not None
    assert error < 5 * np.sqrt(np.trace(found.covariance[3:, 3:]))
    assert found.agreement.stable_share < 0.7
    assert not found.unobservable


def test_a_published_survey_of_which_nearly_all_moved_is_refused(shared_data):
    """7 % stayed; what moved as one lies 1.6 m off and was taken for stable."""
    with pytest.raises(InputError, match="--stable"):
        register(published(shared_data, "17", 3), published(shared_data, "01", 3), RegistrationParameters())
