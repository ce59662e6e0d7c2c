"""What screening refuses, each with its remedy, and what it does not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.interface.parameters import ScreeningParameters
from slopewatch.models.preparation.suitability import Suitability, measure, narrowest, opposite_share, refuse_unsuitable
from slopewatch.models.preparation.two_planes import two_planes
from slopewatch.models.screening.much_marked import warn_if_much_stands_out
from slopewatch.tests.builders.screening_clouds import screen_cloud, slope

SOUND = {"dip": 35.0, "density": 80.0, "opposite_share": 0.0, "rough_share": 0.01}


def judge(parameters: ScreeningParameters | None = None, *, classified=False, bare=False, **found) -> Progress:
    progress = Progress()
    refuse_unsuitable(
        Suitability(**{**SOUND, **found}),
        parameters or ScreeningParameters(),
        "'a.laz'",
        density=(20.0, 450.0),
        classified=classified,
        bare=bare,
        progress=progress,
    )
    return progress


def ridge(share: float, dip: float = 40.0, *, valley: bool = False) -> np.ndarray:
    """A ridge along x, ``share`` of whose ground faces north."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 30, (2, 40_000))
    z = -np.abs(y - 30 * (1 - share)) * np.tan(np.radians(dip)) + rng.normal(0, 0.02, len(x))
    return np.column_stack([x, y, -z if valley else z])


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("valley", [False, True])
def test_the_share_of_ground_that_faces_against_the_rest(share, valley):
    assert opposite_share(ridge(share, valley=valley)) == pytest.approx(share, abs=0.05)


def corner(turn: float, *, rough: float = 0.05) -> np.ndarray:
    """40 m of ground where two slopes of 35 degrees meet that face ``turn`` degrees apart."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-20, 20, (2, 40_000))
    first, second = (np.sin(np.radians(a)) * x + np.cos(np.radians(a)) * y for a in (0.0, turn))
    return np.column_stack([x, y, 0.7 * np.maximum(first, second) + rng.normal(0, rough, len(x))])


@pytest.mark.parametrize("turn", [45.0, 90.0])
def test_two_planes_are_found_and_refused(turn):
    found = two_planes(corner(turn))
    gradients = [np.array([0.7 * np.sin(a), 0.7 * np.cos(a), -1.0]) for a in (0.0, np.radians(turn))]
    cosine = gradients[0] @ gradients[1] / (1 + 0.7**2)
    assert found.angle == pytest.approx(np.degrees(np.arccos(cosine)), abs=1.0)
    assert found.share == pytest.approx(0.5, abs=0.03)
    assert found.left < 0.05
    with pytest.raises(InputError, match=rf"is two slopes \(planes {found.angle:.0f} degrees apart, with 5"):
        screened(corner(turn))


def test_one_slope_is_one_slope():
    assert two_planes(slope()).left > 0.3
    bench = corner(0.0)
    bench[:, 2] -= 2.0 * (bench[:, 1] > 5)
    assert two_planes(bench).left > 0.3
    assert two_planes(slope(40)[:30]).left == 1.0


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_strip_is_as_wide_as_it_is(turn):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 30, 20_000), rng.uniform(0, 3, 20_000)
    c, s = np.cos(turn), np.sin(turn)
    assert narrowest(np.column_stack([c * x - s * y, s * x + c * y])) == pytest.approx(3.0, rel=0.02)


def test_a_region_too_small_for_a_trend_is_refused():
    xyz = slope()
    with pytest.raises(InputError, match=r"is 2\.0 m wide on its slope where screening needs 4 m for the trend"):
        screened(xyz[np.abs(xyz[:, 0] - xyz[:, 0].mean()) < 1.0])
    screened(xyz[np.abs(xyz[:, 0] - xyz[:, 0].mean()) < 2.5])


def test_a_curved_slope_has_one_face():
    rng = np.random.default_rng(2)
    angle, height = rng.uniform(-np.pi / 3, np.pi / 3, 40_000), rng.uniform(0, 15, 40_000)
    radius = 40 - height / np.tan(np.radians(40))
    assert opposite_share(np.column_stack([radius * np.sin(angle), -radius * np.cos(angle), height])) < 0.02


def screened(xyz, **parameters):
    cloud = PointCloud(xyz, CRS.from_epsg(32651), "a.laz", classification=parameters.pop("classes", None))
    return screen_cloud(cloud, ScreeningParameters(screening_method="residual", **parameters))


@pytest.mark.parametrize("valley", [False, True])
def test_two_opposite_faces_are_refused(valley):
    with pytest.raises(InputError, match=r"two opposite faces .*--roi"):
        screened(ridge(0.4, valley=valley))


@pytest.mark.parametrize("dip", [0.0, 8.0])
def test_flat_ground_is_refused(dip):
    with pytest.raises(InputError, match=r"is no slope: its dominant plane dips .*minimum_dip"):
        screened(slope(8000, dip=dip))
    if dip:
        screened(slope(8000, dip=dip), minimum_dip=5.0)


def test_a_wall_is_refused():
    xyz = slope(20_000, dip=30.0)
    c, s = np.cos(np.radians(56)), np.sin(np.radians(56))
    local = xyz - xyz.mean(axis=0)
    wall = np.column_stack([local[:, 0], local[:, 1] * c - local[:, 2] * s, local[:, 1] * s + local[:, 2] * c])
    with pytest.raises(InputError, match="is a wall: its dominant plane dips 8"):
        screened(wall)


def test_plants_are_told_from_ground_and_the_remedy_named():
    rng = np.random.default_rng(3)
    xyz = slope(40_000)
    shrubs = xyz[rng.random(len(xyz)) < 0.4]
    shrubs = shrubs + [0, 0, 1] * rng.uniform(0.2, 1.5, (len(shrubs), 1))
    raw = np.concatenate([xyz, shrubs])
    with pytest.raises(
        InputError, match=r"no bare ground .*--ground extract to extract the ground first, or --ground as_is"
    ):
        screened(raw)
    classes = np.r_[np.full(len(xyz), 2), np.full(len(shrubs), 4)].astype(np.uint8)
    with pytest.raises(InputError, match="--ground class_2 to take its points of class 2"):
        screened(raw, classes=classes)
    screening, _ = screened(raw, classes=classes, ground="class_2")
    assert screening.ground_points == len(xyz)
    screening, _ = screened(raw, ground="as_is")
    assert screening.ground_points == len(raw)


def test_density_outside_the_models_range_is_refused_or_warned_of():
    points = ScreeningParameters(screening_method="network")
    with pytest.raises(InputError, match=r"has 8 points a m² where the method network was made for 20 to 450.* relief"):
        judge(points, density=8.0)
    with pytest.raises(InputError, match=r"has 0\.4 points a m² where the method relief .*--screening-method filter,"):
        judge(ScreeningParameters(screening_method="relief"), density=0.4)
    with pytest.raises(InputError, match="thinned"):
        judge(density=900.0)
    warned = judge(ScreeningParameters(any_density=True), density=8.0)
    assert "not to be relied on" in warned.warnings[0]
    assert judge(density=21.0).warnings == []


@pytest.mark.parametrize("density", [0.4, 1.0, 2.5, 30.0])
def test_the_density_of_sparse_ground_counts_the_empty_places(density):
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(0, 60, (round(3600 * density), 2)), np.zeros(round(3600 * density))])
    found = measure(flat, flat, SimpleNamespace(dip=30.0))
    assert found.density == pytest.approx(density, rel=0.15)


def test_ground_with_holes_has_the_same_density_by_a_part_of_its_points():
    """Half of the square metres are bare of points: they count in neither, as the cloud is dense."""
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(0, 60, (70_000, 2)), np.zeros(70_000)])
    flat = flat[np.floor(flat[:, :2]).sum(axis=1) % 2 == 0]
    part = flat[rng.random(len(flat)) < 0.1]
    whole = measure(flat, flat, SimpleNamespace(dip=30.0)).density
    assert whole == pytest.approx(19.4, rel=0.1)
    assert measure(part, part, SimpleNamespace(dip=30.0), thinned=10.0).density == pytest.approx(whole, rel=0.15)


def test_known_ground_may_be_rough():
    judge(rough_share=0.6, bare=True)
    judge(ScreeningParameters(ground="as_is"), rough_share=0.6)
    with pytest.raises(InputError, match="60 %"):
        judge(rough_share=0.6)


def test_too_few_points_and_what_is_no_number_are_refused():
    with pytest.raises(InputError, match="30 ground points"):
        screened(slope(30))
    xyz = slope(5000)
    xyz[17, 2] = np.nan
    with pytest.raises(InputError, match="not numbers"):
        screened(xyz)
    with pytest.raises(InputError, match="0 ground points"):
        screened(slope(5000), classes=np.ones(5000, dtype=np.uint8), ground="class_2")


def test_much_that_stands_out_is_told():
    labels, count = np.array([0, 1, 2, 0], dtype=np.uint8), np.array([60, 20, 10, 10])
    progress = Progress()
    warn_if_much_stands_out(labels, count, progress)
    assert len(progress.warnings) == 1
    assert progress.warnings[0].startswith("30% of the ground")
    quiet = Progress()
    warn_if_much_stands_out(labels, np.array([80, 10, 5, 5]), quiet)
    assert quiet.warnings == []
