"""Hazards put into ground: where they lie, how high they are, what is labelled, and that nothing else changes."""

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.hazard_shapes import displacement_at, reach, smooth_hazard
from slopewatch.models.preparation.inserted_hazards import (
    SUBSIDENCE,
    UPLIFT,
    VARIED,
    footprint,
    insert_hazards,
    mirrored,
    strip_offset,
    thinned,
    varied_hazard,
)


def ground(density: float = 12.0, width: float = 50.0) -> np.ndarray:
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, width, (round(density * width**2), 2))
    return np.column_stack([xy, 0.3 * np.sin(xy[:, 0] / 3)])


def wanted(count: int, draw=smooth_hazard, seed: int = 1) -> list:
    rng = np.random.default_rng(seed)
    return [draw((-1) ** k * 0.5, (2.0, 3.0, 5.0)[k % 3], rng) for k in range(count)]


def test_points_move_by_the_form_and_only_there() -> None:
    flat = ground()
    scene = insert_hazards(flat, wanted(10), np.random.default_rng(0))
    assert len(scene.hazards) == 10
    expected = sum(displacement_at(one.shape, flat[:, 0], flat[:, 1]) for one in scene.hazards)
    np.testing.assert_allclose(scene.displacement, expected, atol=1e-9)
    np.testing.assert_allclose(scene.flat - flat, np.column_stack([np.zeros((len(flat), 2)), expected]), atol=1e-12)
    for one in scene.hazards:
        middle = displacement_at(one.shape, np.array([one.shape.u]), np.array([one.shape.w]))
        assert middle[0] == pytest.approx((-1) ** one.number * 0.5)
        assert one.label == (UPLIFT if one.number % 2 == 0 else SUBSIDENCE)
    assert (scene.displacement[scene.label == UPLIFT] > 0.05 - 1e-9).all()
    assert (scene.displacement[scene.label == SUBSIDENCE] < -0.05 + 1e-9).all()
    assert (np.abs(scene.displacement[scene.label == 0]) <= 0.05 + 1e-9).all()


def test_hazards_lie_apart_and_on_ground() -> None:
    flat = ground()
    flat = flat[np.hypot(flat[:, 0] - 25, flat[:, 1] - 25) > 8]
    scene = insert_hazards(flat, wanted(20), np.random.default_rng(3), separation=1.5)
    assert len(scene.hazards) >= 15
    middles = np.array([(one.shape.u, one.shape.w) for one in scene.hazards])
    radii = np.array([reach(one.shape) for one in scene.hazards])
    apart = np.hypot(*(middles[:, None] - middles).T) - radii - radii[:, None]
    np.fill_diagonal(apart, np.inf)
    # Places are known to half a cell at either end.
    assert apart.min() > 1.5 - 0.75
    for middle, radius in zip(middles, radii):
        near = np.hypot(*(flat[:, :2] - middle).T) < radius
        assert near.sum() > 0.7 * 12 * np.pi * radius**2


@pytest.mark.parametrize("spacing", [1.0, 2.0])
def test_an_elevation_models_lattice_has_room(spacing: float) -> None:
    x, y = (part.ravel() for part in np.meshgrid(*[np.arange(0, 60, spacing) + spacing / 2] * 2))
    scene = insert_hazards(np.column_stack([x, y, np.zeros(len(x))]), wanted(9), np.random.default_rng(3))
    assert len(scene.hazards) == 9


def test_what_finds_no_room_is_left_out() -> None:
    flat = ground(width=9.0)
    scene = insert_hazards(flat, wanted(12), np.random.default_rng(3))
    assert 1 <= len(scene.hazards) < 12
    assert set(np.unique(scene.hazard)) == {-1, *(one.number for one in scene.hazards)}


def test_the_same_generator_gives_the_same_ground() -> None:
    flat = ground()
    first, again, other = (
        insert_hazards(flat, wanted(8, varied_hazard), np.random.default_rng(seed)) for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first.flat, again.flat)
    assert np.abs(first.flat - other.flat).max() > 0.1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_varied_forms_are_irregular_and_of_both_parts(sign: float) -> None:
    rng = np.random.default_rng(2)
    drawn = [varied_hazard(sign * 0.6, 4.0, rng) for _ in range(60)]
    assert len({one.kind for one in drawn}) >= 5
    assert {one.kind for one in drawn} <= set(VARIED)
    scene = insert_hazards(ground(20, 60.0), drawn, np.random.default_rng(0))
    placed = {one.shape.kind: one for one in scene.hazards}
    for kind in {"slump", "scarp_and_bulge"} & set(placed):
        mine = scene.displacement[scene.hazard == placed[kind].number]
        assert mine.max() > 0.1
        assert mine.min() < -0.1
    assert 0.3 < np.abs(scene.displacement).max() < 1.6


def test_footprints_cover_the_labelled_points() -> None:
    flat = ground(20)
    scene = insert_hazards(flat, wanted(6, varied_hazard), np.random.default_rng(0))
    one = scene.hazards[0]
    up, down = footprint(one.shape, np.zeros(2), 0.2, (250, 250))
    i, j = np.floor(flat[:, :2].T / 0.2).astype(int)
    mine = scene.hazard == one.number
    for cells, value in ((up, UPLIFT), (down, SUBSIDENCE)):
        labelled = mine & (scene.label == value)
        if labelled.any():
            # Cells that the outline cuts differ.
            assert cells[i[labelled], j[labelled]].mean() > 0.85
        assert (mine & (scene.label == value))[cells[i, j]].mean() > 0.85 if cells.any() else not labelled.any()


def test_mirrored_ground_swaps_the_classes() -> None:
    scene = insert_hazards(ground(), wanted(5), np.random.default_rng(0))
    turned = mirrored(scene)
    np.testing.assert_array_equal(turned.flat[:, 2], -scene.flat[:, 2])
    np.testing.assert_array_equal(turned.label == UPLIFT, scene.label == SUBSIDENCE)
    assert [one.label for one in turned.hazards] == [3 - one.label for one in scene.hazards]
    np.testing.assert_array_equal(mirrored(turned).flat, scene.flat)


def test_thinning_and_strips() -> None:
    flat = ground(40)
    few = thinned(flat, 10.0, np.random.default_rng(0))
    assert len(few) == pytest.approx(10 * 50**2, rel=0.05)
    assert (np.diff(few) > 0).all()
    assert len(thinned(flat, 100.0, np.random.default_rng(0))) == len(flat)
    moved = strip_offset(flat, 0.04, np.random.default_rng(1))
    step = moved[:, 2] - flat[:, 2]
    assert set(np.round(np.unique(step), 9)) == {0.0, 0.04}
    assert 0.2 < np.mean(step > 0) < 0.8


def test_bad_hazards_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="cannot be put in"):
        smooth_hazard(0.0, 3.0, rng)
    with pytest.raises(InputError, match="no ground point"):
        insert_hazards(np.zeros((0, 3)), [], rng)
