"""Shapes of hazards against what their kinds promise, and placing against the shares asked for."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.hazard_shapes import LOWERS, RAISES, SHAPES, Hazard
from slopewatch.simulation.hazard_scenes.hazards import displacement
from slopewatch.simulation.hazard_scenes.placing import _Cover, place_hazards
from slopewatch.simulation.hazard_scenes.structures import Cell
from slopewatch.simulation.hazard_scenes.styles import style_of
from slopewatch.simulation.hazard_scenes.surface import new_surface


@pytest.fixture(scope="module")
def surface():
    return new_surface((40.0, 30.0), 0.05, np.random.default_rng(3))


def whole(hazard, surface):
    """The displacement on the whole surface, evaluated on bounds ten times as wide."""
    field = np.zeros(surface.shape)
    rows, columns, dz = displacement(hazard, surface)
    field[rows, columns] = dz
    return field


def make(kind, **values):
    sign = 1 if kind in RAISES and kind != "scarp_and_bulge" else -1
    second = {"slump": 0.2, "scarp_and_bulge": 0.3, "graben": 0.1, "cracked_bulge": -0.15}.get(kind, 0.0)
    given = {"u": 18.0, "w": 14.0, "half_u": 3.0, "half_w": 2.5, "height": 0.4 * sign, "second": second, **values}
    return Hazard(kind, **given)


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_the_peak_has_the_height_asked_for(kind, surface):
    field = whole(make(kind), surface)
    main = field.max() if make(kind).height > 0 else -field.min()
    assert 0.25 < main < 0.75  # 0.4 m, made irregular
    assert (field > 0.03).any() == (kind in RAISES or kind in {"slump", "graben"})
    assert (field < -0.03).any() == (kind in LOWERS or kind == "cracked_bulge")


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_nothing_is_displaced_at_the_bounds(kind, surface):
    for turn in (0.0, 0.7):
        _, _, dz = displacement(make(kind, turn=turn, wobble=0.18), surface)
        border = np.concatenate([dz[0], dz[-1], dz[:, 0], dz[:, -1]])
        assert np.abs(border).max() < 0.02


def test_a_stride_takes_the_same_nodes(surface):
    hazard = make("bulge", turn=0.3)
    rows, columns, coarse = displacement(hazard, surface, 4)
    np.testing.assert_array_equal(coarse, whole(hazard, surface)[rows, columns].astype(np.float32))
    assert rows.start % 4 == 0
    assert columns.start % 4 == 0


def test_a_round_bulge_is_its_formula(surface):
    hazard = make("bulge", half_u=2.0, half_w=2.0, wobble=0.0, exponent=2.0, flatness=2.0, fall=2.0)
    u, w = np.meshgrid(surface.u, surface.w, indexing="ij")
    r2 = ((u - 18.0) ** 2 + (w - 14.0) ** 2) / 4.0
    np.testing.assert_allclose(whole(hazard, surface), 0.4 * np.maximum(1 - r2, 0) ** 2, atol=2e-6)


def test_a_toe_bulge_peaks_below_its_middle_and_a_slump_drops_above_its_toe(surface):
    w = np.broadcast_to(surface.w, surface.shape)
    toe = whole(make("toe_bulge", skew=0.6, wobble=0.0), surface)
    assert w.ravel()[toe.argmax()] < 14.0 - 0.5 * 2.5
    for kind in ("slump", "scarp_and_bulge"):
        field = whole(make(kind, wobble=0.05), surface)
        assert w[field < -0.1].mean() > w[field > 0.05].mean() + 1.5


def test_turning_a_trough_turns_its_long_axis(surface):
    u, w = np.meshgrid(surface.u, surface.w, indexing="ij")
    for turn in (0.0, 0.6, -1.1):
        lowered = whole(make("trough", half_u=0.6, half_w=4.0, turn=turn, wobble=0.0), surface) < -0.1
        spread = np.cov(u[lowered], w[lowered])
        long = np.linalg.eigh(spread)[1][:, 1]
        # The up-slope axis (0, 1) turned against the clock by ``turn``.
        assert abs(long @ (-np.sin(turn), np.cos(turn))) > 0.995


@pytest.mark.parametrize("targets", [(0.23, 0.22), (0.02, 0.04), (0.0, 0.0)])
def test_the_labelled_shares_are_met_without_overlap(surface, targets):
    style = style_of("published" if targets[0] > 0.1 else "realistic")
    hazards = place_hazards(surface, style, targets, 0.05, [], np.random.default_rng(5))
    total = np.zeros(surface.shape)
    covered = np.zeros(surface.shape, dtype=int)
    for hazard in hazards:
        rows, columns, dz = displacement(hazard, surface)
        total[rows, columns] += dz
        covered[rows, columns] += np.abs(dz) > 0.025
    inside = surface.window(0, 0, *surface.extent)
    shares = (total[inside] > 0.05).mean(), (total[inside] < -0.05).mean()
    assert shares == pytest.approx(targets, abs=0.006)
    assert (covered > 1).sum() <= 0.03 * max(1, (covered > 0).sum())
    assert bool(hazards) == (max(targets) > 0)


def test_what_is_covered_and_how_much_room_is_left_is_counted_as_hazards_come(surface):
    cover = _Cover(surface, 0.05, 8.0)
    rng = np.random.default_rng(8)
    circles = []
    for number in range(12):
        hazard = make("bulge" if number % 2 else "bowl", u=rng.uniform(0, 40), w=rng.uniform(0, 30), half_u=2.0)
        rows, columns, dz = displacement(hazard, surface, cover.stride)
        place = cover.coarse(rows, columns)
        before = cover.add(place, dz)
        if number % 3 == 0:
            cover.restore(place, before)
        else:
            cover.occupy(hazard)
            circles.append((hazard.u, hazard.w, 0.8 * np.sqrt(hazard.half_u * hazard.half_w)))
    inside = cover.dz[cover.within]
    assert cover.shares() == pytest.approx([(inside > 0.05).mean(), (inside < -0.05).mean()], abs=1e-12)
    assert cover.shares().min() > 0.01
    room = np.min([np.hypot(cover.u - u, cover.w - w) - radius for u, w, radius in circles], axis=0)
    for radius in (0.5, 2.0, 4.0, 8.0):
        clear = np.abs(room - radius) > 1e-4
        free = np.zeros(room.size, dtype=bool)
        free[cover.free_nodes(radius)] = True
        np.testing.assert_array_equal(free.reshape(room.shape)[clear], (room > radius)[clear])


def test_a_collapsed_cell_lies_in_its_cell(surface):
    cells = [Cell(5.0 + 3 * i, 5.0 + 3 * j, 1.2, 1.1, 0.0) for i in range(10) for j in range(6)]
    found = []
    for seed in range(6):
        hazards = place_hazards(
            surface, style_of("published"), (0.0, 0.15), 0.05, list(cells), np.random.default_rng(seed)
        )
        found += [hazard for hazard in hazards if hazard.kind == "collapsed_cell"]
    assert len(found) >= 3
    for hazard in found:
        assert min(np.hypot(hazard.u - cell.u, hazard.w - cell.w) for cell in cells) == 0.0
        assert (hazard.half_u, hazard.half_w) == (1.2, 1.1)
