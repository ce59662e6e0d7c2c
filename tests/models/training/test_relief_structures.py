"""Structures that are no hazards: means over cells as by brute force, physical sizes, independent of hazards."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.geometry.hazard_shapes import smooth_hazard
from slopewatch.models.preparation.bump_filter import CellHeights
from slopewatch.models.preparation.inserted_hazards import varied_hazard
from slopewatch.models.training import relief_structures
from slopewatch.models.training.relief_patches import Ground, PatchParameters, draw_patch, wanted_hazards
from slopewatch.models.training.relief_structures import (
    STRUCTURES,
    Course,
    coordinates,
    domes,
    drain_section,
    drawn_structures,
    lattice,
    mean_section,
    structures,
)

CELL = 0.5
SHAPE = (60, 44)
FINE = 20


def straight(course: Course, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from a straight course, positive on its left."""
    return (y - course.y) * math.cos(course.angle) - (x - course.x) * math.sin(course.angle)


def brute(form: Callable[[np.ndarray, np.ndarray], np.ndarray], shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """The mean over each cell of ``FINE`` times ``FINE`` samples of a form of x and y."""
    x, y = (((np.arange(n * FINE) + 0.5) * CELL / FINE) for n in shape)
    values = form(x[:, None], y[None, :])
    return values.reshape(shape[0], FINE, shape[1], FINE).mean(axis=(1, 3))


SECTIONS = {
    "beam of 0.3 m": (lambda d: np.where(np.abs(d) < 0.15, 1.0, 0.0), 0.15),
    "step": (lambda d: np.clip(d / 0.3, -0.5, 0.5), 0.15),
    "V": (lambda d: -np.maximum(1 - np.abs(d) / 0.4, 0), 0.4),
    "drain with rims": (lambda d: drain_section(d, 0.3, 0.4, 0.15), 0.6),
}


@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.parametrize("degrees", [0.0, 3.0, 45.0, 90.0, -118.0])
def test_means_over_cells_are_those_of_fine_samples(name: str, degrees: float) -> None:
    section, reach = SECTIONS[name]
    course = Course(13.13, 9.71, math.radians(degrees))
    across = coordinates(SHAPE, CELL, course)[1]
    found = mean_section(section, reach, across, course.normal, CELL)
    truth = brute(lambda x, y: section(straight(course, x, y)))
    # The samples themselves miss up to one row of twenty on either edge of a beam along the cells.
    np.testing.assert_allclose(found, truth, atol=0.055)
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.012


def test_a_beam_narrower_than_a_cell_is_lower_there() -> None:
    across = np.array([0.0, 0.5])
    found = mean_section(lambda d: np.where(np.abs(d) < 0.15, 1.0, 0.0), 0.15, across, (0.0, 1.0), CELL)
    np.testing.assert_allclose(found, [0.3 / 0.5, 0.0], atol=0.01)


def test_a_curved_course_is_as_far_as_its_nearest_point() -> None:
    course = Course(14.0, 10.0, 0.3, bend=1 / 60, wave=0.4, length=25.0, phase=1.0)
    along, across = coordinates(SHAPE, CELL, course)
    t = np.linspace(-60, 60, 12001)
    bow = course.bend / 2 * t**2 + course.wave * np.sin(2 * np.pi * t / course.length + course.phase)
    c, s = math.cos(course.angle), math.sin(course.angle)
    line = np.column_stack([course.x + t * c - bow * s, course.y + t * s + bow * c])
    rng = np.random.default_rng(1)
    near = np.argwhere(np.abs(across) < 1.5)  # as far as sections reach
    for i, j in rng.choice(near, 60):
        distance = np.hypot(*(line - [(i + 0.5) * CELL, (j + 0.5) * CELL]).T).min()
        assert abs(across[i, j]) == pytest.approx(distance, abs=0.05)
    left = np.array([course.x, course.y]) + bow[6000] * np.array([-s, c]) + 1.0 * np.array(course.normal)
    i, j = (left / CELL).astype(int)
    assert across[i, j] > 0.5
    np.testing.assert_allclose(along[i, j], 0.0, atol=0.6)


def test_the_section_of_a_drain_has_its_area() -> None:
    """A U of 1 - (d / half)^4 has 8 / 5 half, each parabolic rim 4 / 3 of its half-width."""
    half, rim, rim_half = 0.35, 0.4, 0.2
    d = np.linspace(-2, 2, 40001)
    area = np.sum(drain_section(d, half, rim, rim_half)) * (d[1] - d[0])
    assert area == pytest.approx(-1.6 * half + 2 * rim * rim_half * 4 / 3, rel=1e-3)
    across = coordinates((8, 400), CELL, Course(2.0, 100.03, 0.0))[1]
    cells = mean_section(lambda q: drain_section(q, half, rim, rim_half), half + 2 * rim_half, across, (0.0, 1.0), CELL)
    np.testing.assert_allclose(cells.sum(axis=1) * CELL, area, rtol=2e-3)


@pytest.mark.parametrize("spacings", [(2.5, 4.0), (6.0, 3.0)])
def test_a_lattice_repeats_itself_at_its_spacing(spacings: tuple[float, float]) -> None:
    field = lattice((160, 160), CELL, Course(40.1, 39.9, 0.0), 0.2, spacings, (30, 30))
    for axis, spacing in enumerate(spacings):
        profile = field.mean(axis=1 - axis)
        profile = profile - profile.mean()
        like = [np.mean(profile[lag:] * profile[: 160 - lag]) for lag in range(1, 20)]
        assert (1 + int(np.argmax(like))) * CELL % spacing == pytest.approx(0.0, abs=1e-9)
        assert like[round(spacing / CELL) - 1] > 0.9 * max(like)


def test_a_lattice_is_one_height_where_beams_cross_and_ends_at_beams() -> None:
    half, spacings, bays = 0.4, (3.0, 4.0), (3, 2)
    course = Course(14.6, 11.2, 0.05)
    field = lattice(SHAPE, CELL, course, half, spacings, bays)

    def wall(d: np.ndarray) -> np.ndarray:
        return np.clip((half - np.abs(d)) / (0.2 * half), 0, 1)

    def form(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        c, s = math.cos(course.angle), math.sin(course.angle)
        along = (x - course.x) * c + (y - course.y) * s
        across = (y - course.y) * c - (x - course.x) * s
        first = np.max([wall(along - 3.0 * k) for k in (-1.5, -0.5, 0.5, 1.5)], axis=0) * (np.abs(across) < 4.4)
        second = np.max([wall(across - 4.0 * k) for k in (-1, 0, 1)], axis=0) * (np.abs(along) < 4.9)
        return np.maximum(first, second)

    truth = brute(form)
    assert field.max() <= 1.0 + 1e-9
    assert np.sqrt(np.mean((field - truth) ** 2)) < 0.02
    assert np.abs(field - truth).max() < 0.1
    assert field.sum() == pytest.approx(truth.sum(), rel=0.01)


def test_domes_have_the_volume_of_half_ellipsoids() -> None:
    places = np.array([[5.2, 6.1], [20.0, 12.77], [12.4, 3.3]])
    widths, heights = np.array([0.3, 1.5, 0.9]), np.array([0.2, 0.6, 0.4])
    field = domes(SHAPE, CELL, places, widths, heights)

    def form(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        r = [((x - u) ** 2 + (y - v) ** 2) / (w / 2) ** 2 for (u, v), w in zip(places, widths, strict=True)]
        return np.max([h * np.sqrt(np.maximum(1 - q, 0)) for h, q in zip(heights, r, strict=True)], axis=0)

    np.testing.assert_allclose(field, brute(form), atol=0.02)
    volume = np.sum(math.pi / 6 * widths**2 * heights)
    assert field.sum() * CELL**2 == pytest.approx(volume, rel=0.03)
    assert np.isfinite(domes((4, 4), CELL, places - 4.9, widths, heights)).all()  # some lie outside


LIMITS = {
    "scarp": (-0.5, 0.5), "gully": (-0.8, 0.0), "drain": (-0.5, 0.25), "beams": (0.0, 0.5), "boulders": (0.0, 0.6),
}  # fmt: skip


@pytest.mark.parametrize("name", STRUCTURES)
def test_structures_are_of_physical_size_and_the_same_again(name: str) -> None:
    low, high = LIMITS[name]
    largest = []
    for seed in range(60):
        field, again = (STRUCTURES[name]((64, 64), CELL, np.random.default_rng(seed)) for _ in range(2))
        np.testing.assert_array_equal(field, again)
        assert field.shape == (64, 64)
        assert np.isfinite(field).all()
        assert low - 1e-9 <= field.min() <= field.max() <= high + 1e-9
        largest.append(np.abs(field).max())
    assert np.median(largest) > 0.05
    assert np.ptp(largest) > 0.2
    assert np.abs(STRUCTURES[name]((64, 64), CELL, np.random.default_rng(99)) - again).max() > 0.01


def test_gullies_run_up_the_slope_and_deepen_downwards() -> None:
    deeper = []
    for seed in range(40):
        depth = -relief_structures.gully((112, 112), CELL, np.random.default_rng(seed)).sum(axis=0)
        deeper.append(depth[:30].mean() - depth[-30:].mean())
    assert np.mean(np.array(deeper) > 0) > 0.85


def test_so_many_patches_have_structures() -> None:
    rng = np.random.default_rng(5)
    counts = np.array([len(drawn_structures(0.35, rng)) for _ in range(2000)])
    assert abs(np.mean(counts > 0) - 0.35) < 4 * math.sqrt(0.35 * 0.65 / 2000)
    assert np.bincount(counts)[1:] == pytest.approx(np.full(3, 2000 * 0.35 / 3), rel=0.25)
    names = [name for _ in range(400) for name in drawn_structures(1.0, rng)]
    assert {names.count(name) / len(names) > 0.15 for name in STRUCTURES} == {True}
    assert not drawn_structures(0.0, rng)


def test_structures_add_up() -> None:
    one = np.random.default_rng(8)
    parts = [STRUCTURES[name]((32, 32), CELL, one) for name in ("drain", "boulders")]
    both = structures(["drain", "boulders"], (32, 32), CELL, np.random.default_rng(8))
    np.testing.assert_allclose(both, parts[0] + parts[1])
    assert not structures([], (32, 32), CELL, one).any()


@pytest.fixture(scope="module")
def ground() -> Ground:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 60, (20000, 3))
    points[:, 2] = 0.3 * points[:, 1] + rng.normal(0, 0.02, len(points))
    return Ground("slope", points, 5.5)


def test_labels_are_those_of_the_hazards_alone(ground: Ground) -> None:
    """The same seed gives the same hazards with and without structures; what differs is the relief."""
    # Heights do not depend on the relief here: the need is a hundredth of what it is, or far below the label's limit.
    parameters = PatchParameters(side=48, needs=(1e-4, 1.001e-4), heights=(0.5, 1.5))
    labelled, changed = 0, []
    for seed in range(6):
        without, with_them = (
            draw_patch([ground], replace(parameters, structures=share), np.random.default_rng(seed))
            for share in (0.0, 1.0)
        )
        np.testing.assert_array_equal(without.labels, with_them.labels)
        assert np.isfinite(with_them.channels).all()
        labelled += np.count_nonzero((without.labels == 1) | (without.labels == 2))
        changed.append(np.abs(without.channels - with_them.channels).max())
    assert labelled > 100
    assert min(changed) > 0.3


def test_structures_are_no_sign_of_hazards(ground: Ground, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over patches, the number of hazards and that of structures do not go together."""
    from slopewatch.models.training import relief_patches

    seen: list[tuple[int, int]] = []
    found: list[list[str]] = []

    def decided(share: float, rng: np.random.Generator) -> list[str]:
        found.append(drawn_structures(share, rng))
        return found[-1]

    def counted(cells: CellHeights, parameters: PatchParameters, rng: np.random.Generator, own=None) -> list:
        area = np.count_nonzero(cells.covered)
        # The unit of heights takes most of the time and has no part in the number.
        monkeypatch.setattr(relief_patches, "hiding_scatter", lambda cells: np.ones(cells.count.shape))
        wanted = wanted_hazards(cells, replace(parameters, filled=4.0 * 1024 / area), rng)
        seen.append((len(wanted), len(found[-1])))
        return []

    monkeypatch.setattr(relief_patches, "drawn_structures", decided)
    monkeypatch.setattr(relief_patches, "wanted_hazards", counted)
    monkeypatch.setattr(relief_patches, "_patch", lambda cells, labels: None)
    parameters = PatchParameters(side=16, densities=(2.0, 8.0))
    for number in range(400):
        draw_patch([ground], parameters, np.random.default_rng([3, number]))
    hazards, built = np.array(seen).T
    assert hazards.std() > 2
    assert 0.25 < np.mean(built > 0) < 0.45
    assert abs(np.corrcoef(hazards, built > 0)[0, 1]) < 4 / math.sqrt(400)


@pytest.mark.parametrize("draw", [smooth_hazard, varied_hazard])
def test_hazards_are_as_wide_and_as_long_as_real_ones(draw: Callable) -> None:
    rng = np.random.default_rng(2)
    drawn = [draw(0.4, 4.0, rng, elongations=(0.4, 2.5)) for _ in range(300)]
    ratios = np.array([one.half_u / one.half_w for one in drawn if one.kind not in ("slump", "scarp_and_bulge")])
    assert 0.399 < ratios.min() < 0.5
    assert 2.0 < ratios.max() < 2.501
    areas = np.array([one.half_u * one.half_w for one in drawn if one.kind not in ("slump", "scarp_and_bulge")])
    np.testing.assert_allclose(areas, 4.0)
