"""Textures, roughness, cross-sections and landforms against their own promises, computed another way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from slopewatch.simulation.hazard_scenes import landforms, structures
from slopewatch.simulation.hazard_scenes.bands import band
from slopewatch.simulation.hazard_scenes.negatives import Negative
from slopewatch.simulation.hazard_scenes.styles import SceneSpec
from slopewatch.simulation.hazard_scenes.surface import (
    TILE,
    new_surface,
    periodic_texture,
    resample,
    roughen,
    smooth_line,
)
from slopewatch.simulation.hazard_scenes.terrain import Terrain, build_terrain


def flat(extent=(40.0, 30.0), step=0.05, dip=0.7):
    surface = new_surface(extent, step, np.random.default_rng(1))
    shift = np.zeros(surface.shape[0], dtype=np.float32)
    return Terrain(surface, dip, (), ((0.0, extent[1]),), shift, 0.01)


def test_the_texture_has_the_power_law_asked_for():
    step = 0.1
    tile = periodic_texture(step, 3.0, 0.3, 20.0, np.random.default_rng(2))
    assert tile.std() == pytest.approx(1.0, rel=1e-3)
    power = np.abs(np.fft.fft2(tile)) ** 2
    k = np.hypot(np.fft.fftfreq(TILE, step)[:, None], np.fft.fftfreq(TILE, step)[None, :])
    low, high = ((k > 0.15) & (k < 0.2)), ((k > 0.9) & (k < 1.2))
    slope = math.log(power[high].mean() / power[low].mean()) / math.log(k[high].mean() / k[low].mean())
    # The soft end of the band at 0.3 m takes a little of the upper ring.
    assert slope == pytest.approx(-3.0, abs=0.2)
    # Periodic: the seam is as smooth as everywhere else.
    assert np.abs(tile[0] - tile[-1]).mean() == pytest.approx(np.abs(np.diff(tile, axis=0)).mean(), rel=0.2)


@pytest.mark.parametrize("shift", [0, 1, 300, 511])
@pytest.mark.parametrize("window", [(0.0, 0.0, 3.0, 5.0), (20.0, 22.0, 29.0, 28.0), (-1.5, -1.5, 41.5, 31.5)])
@pytest.mark.parametrize("stride", [1, 4])
def test_textures_are_laid_side_by_side(shift, window, stride):
    surface = flat().surface
    rows, columns = surface.window(*window, stride)
    i, j = (np.arange(nodes)[part] for nodes, part in zip(surface.shape, (rows, columns)))
    expected = np.tile(surface.bumps, (5, 5))[np.ix_(i + shift, j + 3 * shift)]
    np.testing.assert_array_equal(surface.texture(surface.bumps, rows, columns, shift), expected)
    empty = surface.texture(surface.bumps, slice(7, 7), columns, shift)
    assert empty.shape == (0, len(j))


def test_roughness_has_the_rms_asked_for_and_tells_its_fine_part():
    terrain = flat((60.0, 60.0), 0.1)
    fine = roughen(terrain.surface, 0.08, 3.0, np.random.default_rng(4))
    height = terrain.surface.height
    assert height.std() == pytest.approx(0.08, rel=0.05)
    # What a filter with a cut-off at a wavelength of 1 m leaves (half the power at k = 1 / m).
    rest = height - gaussian_filter(height, math.sqrt(math.log(2)) / (2 * math.pi) * math.sqrt(2) / 0.1)
    assert rest.std() == pytest.approx(fine, rel=0.35)
    assert 0.01 < fine < 0.05


def test_resampling_is_linear_interpolation():
    values = np.random.default_rng(5).standard_normal((7, 9)).astype(np.float32)
    places = np.meshgrid(np.arange(20) * 0.3, np.arange(25) * 0.3, indexing="ij")
    np.testing.assert_allclose(
        resample(values, 0.3, (20, 25)), map_coordinates(values.astype(float), places, order=1), atol=1e-5
    )


def test_smooth_lines_wander_over_their_wavelength():
    lines = np.stack([smooth_line(2000, 0.1, 10.0, np.random.default_rng(seed)) for seed in range(60)])
    assert lines.std() == pytest.approx(1.0, rel=0.15)
    near = (lines[:, :-5] * lines[:, 5:]).mean()
    far = (lines[:, :-200] * lines[:, 200:]).mean()
    assert near > 0.85
    assert abs(far) < 0.15


def test_berms_lie_level_and_faces_stand_at_the_ratios_of_cut_slopes():
    seen = 0
    for seed in range(12):
        spec = SceneSpec("published", seed, 4000.0, 100.0, 0.0, 0.0)
        terrain = build_terrain(spec, spec.generator(1))
        if not terrain.benches:
            continue
        seen += 1
        surface = terrain.surface
        section = surface.height.mean(axis=0)
        c, s = math.cos(terrain.dip), math.sin(terrain.dip)
        y, z = surface.w * c - section * s, surface.w * s + section * c
        for bench in terrain.benches:
            berm = (surface.w > bench.outer + 0.5) & (surface.w < bench.inner - 0.5)
            if berm.sum() > 5:
                assert np.polyfit(y[berm], z[berm], 1)[0] == pytest.approx(-0.03, abs=0.1)
        for low, high in terrain.faces:
            face = (surface.w > low + 1.0) & (surface.w < high - 1.0)
            assert 1 / 1.6 < np.polyfit(y[face], z[face], 1)[0] < 1 / 0.4
    assert seen >= 4


def test_bench_edges_are_marked_where_the_benches_wander():
    spec = next(
        spec
        for spec in (SceneSpec("published", seed, 2000.0, 80.0, 0.0, 0.0) for seed in range(40))
        if build_terrain(spec, spec.generator(1)).benches
    )
    terrain = build_terrain(spec, spec.generator(1))
    surface = terrain.surface
    edges = [place for bench in terrain.benches for place in (bench.outer, bench.inner)]
    away = np.min([np.abs(surface.w[None, :] - (edge + terrain.shift)[:, None]) for edge in edges], axis=0)
    np.testing.assert_array_equal(surface.negative == Negative.BENCH_EDGE, away < 0.35)


def test_a_band_knows_the_distance_to_its_line():
    surface = flat().surface
    line = (10.0 + 0.1 * surface.w).astype(np.float32)
    strip = band(surface, 1, 5.0, 12.0, line, 0.8)
    assert strip is not None
    u, w = surface.nodes(strip.rows, strip.columns)
    np.testing.assert_allclose(strip.across, u - (10.0 + 0.1 * w), atol=1e-5)
    assert strip.along.min() == pytest.approx(5.0, abs=0.03)
    assert strip.along.max() == pytest.approx(12.0, abs=0.03)
    assert band(surface, 1, 5.0, 12.0, 500.0, 0.8) is None


@pytest.mark.parametrize(
    ("build", "kind", "lowest", "highest"),
    [
        (structures.drains, Negative.DRAIN, -0.6, 0.2),
        (structures.ditches, Negative.DITCH, -0.6, 0.2),
        (structures.lattice, Negative.BEAM, -0.15, 0.45),
        (structures.stairs, Negative.STAIRS, -0.15, 0.3),
        (structures.pipes, Negative.PIPE, 0.0, 0.6),
        (landforms.rills, Negative.RILL, -1.0, 0.0),
        (landforms.gullies, Negative.GULLY, -2.0, 0.0),
        (landforms.steps, Negative.STEP, 0.0, 1.3),
        (landforms.boulders, Negative.BOULDER, 0.0, 3.0),
        (landforms.spoil, Negative.SPOIL, -0.3, 3.0),
        (landforms.stumps, Negative.STUMP, 0.0, 0.9),
        (landforms.terracettes, Negative.TERRACETTE, -0.1, 0.1),
        (landforms.facets, Negative.FACET, -0.5, 0.5),
    ],
    ids=lambda value: value.name.lower() if isinstance(value, Negative) else "",
)
def test_negatives_change_the_ground_where_they_are_marked(build, kind, lowest, highest):
    changed = 0
    for seed in range(4):
        terrain = flat()
        build(terrain, np.random.default_rng(seed))
        height, mark = terrain.surface.height, terrain.surface.negative
        assert set(np.unique(mark)) <= {0, kind}
        assert height.min() >= lowest
        assert height.max() <= highest
        if (mark == kind).any():
            changed += 1
            assert np.abs(height[mark == kind]).max() > 0.03
            # What is unmarked is hardly changed, but for the ground that runs out above a step.
            if kind is not Negative.STEP:
                assert np.abs(height[mark == 0]).mean() < 0.03
    assert changed >= 3


def test_the_cells_of_a_lattice_lie_between_its_beams():
    seen = 0
    for seed in range(6):
        terrain = flat()
        for cell in structures.lattice(terrain, np.random.default_rng(seed)):
            seen += 1
            i, j = (round((x - terrain.surface.low) / terrain.surface.step) for x in (cell.u, cell.w))
            assert terrain.surface.negative[i, j] == Negative.NONE
            # Just beyond the half-axis along its own axis there is a beam.
            reach = cell.half_u + 0.12
            u, w = cell.u + reach * math.cos(cell.turn), cell.w + reach * math.sin(cell.turn)
            i, j = (round((x - terrain.surface.low) / terrain.surface.step) for x in (u, w))
            assert terrain.surface.negative[i, j] == Negative.BEAM
    assert seen > 30
