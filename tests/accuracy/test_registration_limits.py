"""What a registration must not hide: bias, little or no stable ground, motions that nothing fixes, little overlap."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.grid.grid import cell_index, snapped_grid
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.quality import agreement, widened
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.surface import Surface
from slopewatch.interface.parameters import RegistrationParameters

SIDE = 20.0
RNG = np.random.default_rng(5)
RELIEF = sum(
    weight * sigma * gaussian_filter(RNG.normal(size=(420, 420)), sigma)
    for sigma, weight in ((3, 0.06), (10, 0.12), (30, 0.3))
)


def scan(seed: int, n: int = 30_000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, n))
    z = 0.7 * y + map_coordinates(RELIEF, [y * 20, x * 20], order=1) + rng.normal(0, 0.01, n)
    return np.column_stack([x, y, z])


def lowered(after: np.ndarray, share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """All but ``share`` of the surface lowered, by 0.05 to 0.8 m from place to place; and which part stayed."""
    rng = np.random.default_rng(seed)
    field = gaussian_filter(rng.normal(size=(100, 100)), 8)
    value = map_coordinates(field, [after[:, 1] * 4.5, after[:, 0] * 4.5], order=1)
    rank = np.argsort(np.argsort(value)) / len(value)
    stays = rank <= share
    changed = after.copy()
    changed[:, 2] -= np.where(stays, 0.0, 0.05 + 0.75 * (rank - share) / max(1 - share, 1e-9))
    return changed, stays


def test_a_uniform_rise_that_is_left_widens_the_level_and_one_that_is_taken_off_is_named():
    reference, after = scan(1), scan(2)
    left = register(reference, after + [0, 0, 0.06], RegistrationParameters(method="none"))
    assert left.registration_error > 0.05
    taken = register(reference, after + [0, 0, 0.4], RegistrationParameters())
    assert taken.vertical_translation == pytest.approx(-0.4, abs=0.01)
    assert any("-0.3" in w and "datum" in w for w in taken.warnings)
    # what surveys usually err by is a figure of the record and no warning
    usual = register(reference, after + [0.05, 0.04, 0.05], RegistrationParameters())
    assert usual.warnings == ()
    assert usual.summary()["registration_normal_translation_m"] == pytest.approx(
        -(0.05 - 0.7 * 0.04) / np.hypot(1, 0.7), abs=0.005
    )


def test_no_stable_ground_is_refused_unless_accepted_with_a_wide_error():
    """Every square metre went up or down by as much as a metre, each its own way."""
    reference, after = scan(1, 15_000), scan(2, 15_000)
    steps = np.random.default_rng(8).uniform(-1.0, 1.0, (20, 20))
    after[:, 2] += steps[after[:, 0].astype(int), after[:, 1].astype(int)]
    with pytest.raises(InputError, match=r"--stable.*--accept-unstable"):
        register(reference, after, RegistrationParameters())
    result = register(reference, after, RegistrationParameters(accept_unstable=True))
    assert np.array_equal(result.transform.matrix, np.eye(4))
    assert result.agreement.stable_share < 0.3
    assert any("No stable ground" in w for w in result.warnings)
    assert result.registration_error > 0.2


def test_little_stable_ground_is_named_and_registered_on():
    """A third stayed and is the one part that agrees on a motion: it is right, and says so."""
    reference = scan(1)
    after, stays = lowered(scan(2), 0.35, 3)
    result = register(reference, after, RegistrationParameters(minimum_stable_share=0.6))
    assert any("least share of stable ground" in w for w in result.warnings)
    away = (result.transform.apply(after) - after)[stays] @ np.array([0.0, -0.7, 1.0])
    assert np.sqrt(np.mean(away**2)) < min(0.003, 3 * result.registration_error)


def test_little_stable_ground_that_is_not_surely_it_widens_the_level():
    reference = scan(1)
    after, _ = lowered(scan(2), 0.35, 3)
    matcher = Matcher(Surface(reference - reference.mean(axis=0), 0.1), Surface(after - reference.mean(axis=0), 0.1))
    quality = agreement(matcher, Pose.identity(), 1.0)
    assert quality.stable_share < 0.6
    assert widened(0.001, quality, 0.6) > 0.1 * quality.spread > 0.01
    assert widened(0.001, quality, 0.1) == 0.001


def test_a_tilt_that_nothing_fixes_is_named_and_widens_the_level():
    """A strip half a metre wide along a road's edge: hardly anything stops it from rolling."""
    rng = np.random.default_rng(0)
    clouds = []
    for _ in range(2):
        x, y = rng.uniform(0, 30, 6000), rng.uniform(0, 0.3, 6000)
        clouds.append(np.column_stack([x, y, 0.02 * np.sin(x) + rng.normal(0, 0.01, x.size)]))
    result = register(*clouds, RegistrationParameters())
    assert result.unobservable
    assert any("does not fix" in w for w in result.warnings)
    wide = register(scan(1), scan(2), RegistrationParameters())
    assert result.registration_error > 3 * wide.registration_error


def test_the_weakest_direction_is_that_of_the_weakest_relief():
    def ribbed(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(0, SIDE, (2, 30_000))
        relief = 0.2 * np.sin(2 * x) + 0.02 * np.sin(2.5 * y + 0.3 * x)
        return np.column_stack([x, y, 0.7 * y + relief + rng.normal(0, 0.01, x.size)])

    result = register(ribbed(1), ribbed(2), RegistrationParameters())
    assert result.weakest is not None
    name, sd = result.weakest
    assert name == "sliding up and down the slope"
    assert np.linalg.norm(result.transform.translation) < 4 * sd
    assert result.summary()["weakest_direction_error_m"] == sd


def test_stable_ground_can_be_drawn():
    reference, after = scan(1), scan(2)
    after[(after[:, 0] < 8) & (after[:, 1] < 8), 2] -= 0.4
    found = register(reference, after, RegistrationParameters())
    grid = snapped_grid((0.0, 0.0, SIDE, SIDE), 1.0)
    number = cell_index(found.agreement.sample + found.transform.centre, grid)
    inside = number >= 0
    compared = np.bincount(number[inside], minlength=grid.rows * grid.columns)
    stable = np.bincount(number[inside], found.agreement.agrees[inside], grid.rows * grid.columns)
    with np.errstate(invalid="ignore"):
        share = (stable / compared).reshape(grid.shape)
    # rows run from north to south
    assert np.nanmedian(share[13:, :7]) < 0.2
    assert np.nanmedian(share[:11, 9:]) > 0.9
    assert np.nanmin(share[13:, :7]) == 0.0


def test_epochs_apart_are_refused_with_both_extents():
    reference = scan(1, 3000)
    with pytest.raises(InputError, match=r"earlier extends over \(0\.0.*later over \(500\.0"):
        register(reference, reference + [500.0, 0, 0], RegistrationParameters())


def test_a_tiny_overlap_is_reported_and_an_overlap_of_nothing_refused():
    reference, later = scan(1), scan(2)
    result = register(
        reference[reference[:, 0] < 0.55 * SIDE], later[later[:, 0] > 0.5 * SIDE], RegistrationParameters()
    )
    assert result.agreement.overlap_share < 0.2
    assert any("counterpart" in w for w in result.warnings)
    # another surface that overlaps by a strip
    with pytest.raises(InputError, match="--stable"):
        register(reference, later + [0.9 * SIDE, 0.0, 0.0], RegistrationParameters())
    # extents that overlap, surfaces that do not
    west = reference[reference[:, 1] > reference[:, 0] + 1]
    east = reference[reference[:, 1] < reference[:, 0] - 1]
    with pytest.raises(InputError, match=r"overlap|share any surface"):
        register(west, east, RegistrationParameters(maximum_offset=0.5))
