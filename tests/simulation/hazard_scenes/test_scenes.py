"""Whole scenes: the labels against the ground itself, the scan against brute-force rays, the sets against their
promises.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from slopewatch.engine.core.errors import InputError
from slopewatch.simulation.hazard_scenes.negatives import Negative
from slopewatch.simulation.hazard_scenes.picture import draw_panels, panels, shade
from slopewatch.simulation.hazard_scenes.scan import Strip, scan
from slopewatch.simulation.hazard_scenes.scenes import build_scene, scene
from slopewatch.simulation.hazard_scenes.sets import (
    FIRST_TRAINING_SEED,
    PUBLISHED_SHARES,
    SETS,
    published_set,
    realistic_set,
    shifted_set,
    training_specs,
)
from slopewatch.simulation.hazard_scenes.styles import STYLES, draw_spec, style_of
from slopewatch.simulation.hazard_scenes.surface import new_surface


@pytest.fixture(scope="module")
def small():
    return scene(11, "published", area=900.0, density=120.0)


def test_the_same_seed_gives_the_same_points_and_another_seed_others(small):
    again, other = scene(11, "published", area=900.0, density=120.0), scene(12, "published", area=900.0, density=120.0)
    np.testing.assert_array_equal(small.xyz, again.xyz)
    np.testing.assert_array_equal(small.label, again.label)
    np.testing.assert_array_equal(small.hazards, again.hazards)
    assert len(other) != len(small)


def test_labels_are_the_sign_of_the_displacement_beyond_the_limit(small):
    assert small.limit >= max(0.03, 2 * 0.018)
    expected = np.where(small.displacement > small.limit, 1, np.where(small.displacement < -small.limit, 2, 0))
    np.testing.assert_array_equal(small.label, expected)
    near = np.abs(np.abs(small.displacement) - small.limit) < 0.5 * small.limit
    assert (small.ignore == near).mean() > 0.9999
    assert not small.ignore[small.displacement == 0].any()


def test_the_cloud_with_hazards_differs_from_that_without_by_the_displacement():
    """The displacement that labels state, against two clouds of the same slope gridded on their own."""
    spec = draw_spec(4, "published", area=700.0, density=300.0)
    after, before = build_scene(spec), build_scene(replace(spec, uplift=0.0, subsidence=0.0))
    assert not before.label.any()
    assert not len(before.hazards)

    def grid(cloud, values):
        plane = cloud.to_plane(cloud.xyz)
        i, j = (np.floor(plane[:, k] / 0.4).astype(int).clip(0, 199) for k in (0, 1))
        count = np.bincount(i * 200 + j, minlength=40_000)
        with np.errstate(invalid="ignore"):
            return np.where(count >= 8, np.bincount(i * 200 + j, weights=values, minlength=40_000) / count, np.nan)

    clean_after, clean_before = (_without_residue(cloud) for cloud in (after, before))
    measured = grid(clean_after, clean_after.to_plane(clean_after.xyz)[:, 2]) - grid(
        clean_before, clean_before.to_plane(clean_before.xyz)[:, 2]
    )
    known = grid(clean_after, clean_after.displacement)
    both = ~np.isnan(measured) & ~np.isnan(known)
    assert both.sum() > 2000
    error = measured[both] - known[both]
    assert abs(np.median(error)) < 0.003
    assert np.median(np.abs(error)) < 0.015
    assert np.corrcoef(measured[both], known[both])[0, 1] > 0.97


def _without_residue(cloud):
    keep = (cloud.negative != Negative.RESIDUE) & (cloud.negative == Negative.NONE)
    return replace(cloud, xyz=cloud.xyz[keep], displacement=cloud.displacement[keep])


def test_the_table_of_hazards_describes_the_points(small):
    table = small.hazards
    assert len(table) > 5
    reached = []
    for row in table:
        mine = (small.hazard == row["id"]) & (small.label == row["label"])
        if mine.sum() < 60:
            continue
        assert np.abs(small.displacement[mine]).max() <= row["amplitude"] + 1e-3
        reached.append(np.abs(small.displacement[mine]).max() / row["amplitude"])
        # Points thin out under plants and at the edges; nowhere are there more than the strips give.
        assert mine.sum() / small.spec.density == pytest.approx(row["area"], rel=0.75)
        assert np.hypot(*(small.xyz[mine, :2].mean(axis=0) - (row["x"], row["y"]))) < 0.6 * row["size"] + 0.3
        assert row["size"] == pytest.approx(2 * math.sqrt(row["area"] / math.pi))
    # Some are cut by the region's edge or hidden under plants.
    assert np.median(reached) > 0.95
    labelled = small.label > 0
    assert np.isin(small.hazard[labelled], table["id"]).mean() > 0.999


def test_spikes_and_noise_are_those_of_the_style():
    """On a slope without anything the points scatter about their neighbours by the range noise."""
    cloud = scene(3, "realistic", area=600.0, density=350.0)
    spikes = (cloud.negative == Negative.RESIDUE).mean()
    assert 0.005 < spikes < 0.06
    assert set(np.unique(cloud.strip)) == set(range(int(cloud.strip.max()) + 1))
    assert cloud.strip.max() >= 1
    # To the millimetre, far from the origin, and on the plane the scene names.
    assert np.abs(cloud.xyz * 1000 - np.round(cloud.xyz * 1000)).max() < 1e-5
    assert cloud.xyz[:, 0].min() > 200_000
    plane = cloud.to_plane(cloud.xyz)
    normal = np.linalg.svd(plane[::50] - plane[::50].mean(axis=0), full_matrices=False)[2][2]
    assert abs(normal[2]) > 0.99


def test_no_ray_passes_through_the_ground_and_shadows_stay_empty():
    surface = new_surface((20.0, 30.0), 0.05, np.random.default_rng(6))
    u, w = np.meshgrid(surface.u, surface.w, indexing="ij")
    surface.height[...] = 0.15 * np.sin(u) + 0.1 * np.cos(2 * w)
    wall = (w > 14.0) & (w < 14.3)
    surface.height[wall] += 2.0
    strip = Strip(w=4.0, n=12.0, lowest=math.atan(-0.3), highest=math.atan(2.0), offset=0.0)
    for pattern in (0.0, 1.0):
        style = replace(style_of("published"), random_pattern=pattern)
        hits = scan(surface, [strip], 20_000, style, np.random.default_rng(7))
        assert len(hits.u) > 15_000

        def height(uu, ww):
            # The scan takes the nearest node of u.
            node = np.rint((uu - surface.low) / 0.05)
            return map_coordinates(surface.height, [node, (ww - surface.low) / 0.05], order=1, mode="nearest")

        # Brute force: along each ray, every 5 cm from above the wall to just before its hit, there is air.
        chosen = np.random.default_rng(8).choice(len(hits.u), 1500, replace=False)
        uu, hit_w, tangent = hits.u[chosen], hits.w[chosen], hits.tangent[chosen]
        hit_n = strip.n - (hit_w - strip.w) / tangent
        assert np.abs(hit_n - height(uu, hit_w))[np.abs(tangent) > 0.1].mean() < 0.005
        for above in np.arange(0.15, 3.0, 0.05):
            place = hit_w - above * tangent
            inside = (place > 0) & (place < 30)
            assert (height(uu, place) < strip.n - (place - strip.w) / tangent + 0.02)[inside].mean() > 0.998
        # Behind the wall, as seen from the sensor, nothing is hit: its top is at n = 2 above w = 14.3.
        shadow_end = strip.w + (14.3 - strip.w) * (12.0 - 0.3) / (12.0 - 2.0)
        assert not ((hits.w > 14.4) & (hits.w < shadow_end - 0.8)).any()
        assert ((hits.w > shadow_end + 1.0) & (hits.w < 25)).sum() > 500


def test_the_published_set_has_the_published_size_and_shares():
    benchmark = published_set()
    assert len(benchmark) == 92
    assert benchmark.points == pytest.approx(86_500_000, rel=0.002)
    assert len({spec.seed for spec in benchmark.specs}) == 92
    # Two scenes, as specified; the means of all were measured with the command in the documentation.
    for spec in benchmark.specs[:2]:
        part = replace(spec, area=min(spec.area, 1500.0))
        built = build_scene(part)
        assert built.shares[1:] == pytest.approx((part.uplift, part.subsidence), abs=0.03)
        assert len(built) == pytest.approx(part.points, rel=0.06)
    weight = np.array([spec.points for spec in benchmark.specs])
    for name, published in (("uplift", PUBLISHED_SHARES[1]), ("subsidence", PUBLISHED_SHARES[2])):
        assert np.average([getattr(s, name) for s in benchmark.specs], weights=weight) == pytest.approx(
            published, abs=0.005
        )


def test_a_fifth_of_the_realistic_scenes_is_without_hazards():
    for benchmark in (realistic_set(), shifted_set()):
        empty = [spec for spec in benchmark.specs if spec.uplift == spec.subsidence == 0]
        assert len(empty) == len(benchmark) / 5
        weight = np.array([spec.points for spec in benchmark.specs])
        for name in ("uplift", "subsidence"):
            mean = np.average([getattr(spec, name) for spec in benchmark.specs], weights=weight)
            assert mean == pytest.approx(0.025, abs=0.002)
        built = build_scene(replace(empty[0], area=400.0))
        assert not built.label.any()


def test_training_never_sees_a_scene_of_a_set():
    train = {(spec.kind, spec.seed) for kind in STYLES for spec in training_specs(kind, 50)}
    for benchmark in (published_set(), realistic_set(), shifted_set()):
        assert not train & {(spec.kind, spec.seed) for spec in benchmark.specs}
        assert max(spec.seed for spec in benchmark.specs) < FIRST_TRAINING_SEED
    first, second = (list(training_specs("published", 5, first=k)) for k in (0, 5))
    assert all(a.seed + 5 == b.seed for a, b in zip(first, second))
    assert all(b.seed == a.seed + 1 for a, b in pairwise(first))


def test_the_shifted_style_shares_neither_hazards_nor_ranges_of_noise_with_the_others():
    shifted, others = STYLES["shifted"], [STYLES["published"], STYLES["realistic"]]
    for other in others:
        assert not set(shifted.hazards) & set(other.hazards)
        assert shifted.range_noise[0] > other.range_noise[1]
        assert shifted.exponent[1] < other.exponent[0]


def test_a_picture_shows_labels_where_the_points_have_them(small, tmp_path):
    grey, label, negative = shade(small, 0.3)
    assert grey.shape == label.shape == negative.shape
    plane = small.to_plane(small.xyz)
    north = (math.floor(plane[:, 1].max() / 0.3 + 1e-9) + 1) * 0.3
    west = math.floor(plane[:, 0].min() / 0.3 + 1e-9) * 0.3
    row = np.floor((north - plane[:, 1]) / 0.3).astype(int)
    column = np.floor((plane[:, 0] - west) / 0.3).astype(int)
    assert (label[row, column] == small.label).mean() > 0.93
    draw_panels([panels(small)], tmp_path / "scene.png")
    assert (tmp_path / "scene.png").stat().st_size > 20_000


def test_an_unknown_kind_and_a_negative_seed_are_refused():
    with pytest.raises(InputError, match="published, realistic, shifted"):
        scene(1, "lunar")
    with pytest.raises(InputError, match="seed"):
        scene(-1)


PINNED_SETS = {
    "published": (
        (659648.4115735879, 20.933442546207793, 20.186444071432305),
        7355, [3835, 2090, 1430], [675675.2781759351, 4304546.749666886, 140.72385248130516], 14.996063662308673, 7507,
    ),
    "realistic": (
        (227570.7402387758, 0.923945659690954, 0.9009078570044972),
        6383, [5892, 187, 304], [433634.4559249552, 2933151.3575586714, 387.0616265079119], 15.874923733050133, 10660,
    ),
    "shifted": (
        (169750.92860970352, 0.9941924543866095, 0.9353585970634933),
        7018, [6463, 296, 259], [301592.1826641487, 2902322.2189813363, 747.6829481333737], 14.655663406164399, 56191,
    ),
}  # fmt: skip
"""Sums of the specifications' areas and shares; of a small scene: points, labels, mean, scatter, negatives."""


@pytest.mark.parametrize("name", PINNED_SETS)
def test_the_sets_are_those_that_scores_were_published_on(name):
    """Another scene of the same seed needs another SIMULATOR_VERSION, and new scores of all models."""
    sums, count, labels, mean, scatter, negative = PINNED_SETS[name]
    specs = SETS[name]().specs
    found = [sum(getattr(spec, field) for spec in specs) for field in ("area", "uplift", "subsidence")]
    np.testing.assert_allclose(found, sums, rtol=1e-12)
    small = build_scene(replace(specs[1], area=500.0, density=16.0))
    assert len(small) == count
    assert np.bincount(small.label).tolist() == labels
    np.testing.assert_allclose(small.xyz.mean(axis=0), mean, rtol=0, atol=1e-6)
    assert small.xyz.std(axis=0).sum() == pytest.approx(scatter, abs=1e-6)
    assert small.negative.sum() == negative
