"""Hazards put into points of a tilted plane, whose normal, edges and holes are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.hazard_shapes import outline, reach
from slopewatch.simulation.hazard_scenes.known_hazards import Site, put_hazards, room_for

DIP, AZIMUTH = np.radians(35.0), np.radians(50.0)
NORMAL = np.array([np.sin(DIP) * np.sin(AZIMUTH), np.sin(DIP) * np.cos(AZIMUTH), np.cos(DIP)])
ACROSS = np.array([-np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
UP = np.cross(NORMAL, ACROSS)
ORIGIN = np.array([377_000.0, 7_655_950.0, 150.0])
HOLE, HOLE_RADIUS = np.array([9.0, 20.0]), 4.0
SPARSE = 22.0
"""Beyond this u there is 1 point a m² instead of 25."""
WANTED = [(0.3, 3.0), (-0.3, 3.0), (0.15, 2.0), (-0.5, 5.0), (0.5, 2.0)]


def places(seed: int = 0) -> np.ndarray:
    """(n, 2) places on the plane: 30 m square with a hole and a sparse side."""
    rng = np.random.default_rng(seed)
    uw = rng.uniform(0, 30, (30 * 30 * 25, 2))
    keep = np.hypot(*(uw - HOLE).T) > HOLE_RADIUS
    keep &= (uw[:, 0] < SPARSE) | (rng.random(len(uw)) < 0.04)
    return uw[keep]


def to_world(uw: np.ndarray, n: np.ndarray | float = 0.0) -> np.ndarray:
    return ORIGIN + uw[:, :1] * ACROSS + uw[:, 1:2] * UP + np.reshape(n, (-1, 1)) * NORMAL


def to_plane(xyz: np.ndarray) -> np.ndarray:
    return (xyz - ORIGIN) @ np.column_stack([ACROSS, UP, NORMAL])


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    return to_world(places())


@pytest.fixture(scope="module")
def scenes(ground):
    made = [put_hazards(ground, WANTED, seed) for seed in range(8)]
    assert sum(len(scene.hazards) for scene in made) >= 2 * len(made)
    return made


def middles(scene) -> np.ndarray:
    table = scene.hazards
    return to_plane(np.column_stack([table["x"], table["y"], table["z"]]))


def test_points_move_along_the_normal_only(ground, scenes):
    for scene in scenes:
        moved = scene.xyz - ground
        along = moved @ NORMAL
        assert np.abs(moved - along[:, None] * NORMAL).max() < 1e-6
        assert along == pytest.approx(scene.displacement, abs=1e-6)


def test_the_middle_has_the_full_height_and_nothing_moves_outside(ground, scenes):
    uw = to_plane(ground)[:, :2]
    for scene in scenes:
        heights = (scene.xyz - ground) @ NORMAL
        untouched = np.ones(len(ground), dtype=bool)
        for row, place in zip(scene.hazards, middles(scene), strict=True):
            height = row["amplitude"] * (1 if row["label"] == 1 else -1)
            distance = np.hypot(*(uw - place[:2]).T)
            # at 25 points a m² one lies within a few decimetres; the profile is flat there
            assert heights[distance.argmin()] == pytest.approx(height, rel=0.1)
            # axes at most a third longer than the diameter says, corners of a super-ellipse a little more
            untouched &= distance > row["diameter"] / 2 * 1.35
            within = np.abs(heights[distance < row["diameter"] / 2 * 1.35])
            assert within.max() <= row["amplitude"] * (1 + 1e-6)
        assert np.all(heights[untouched] == 0)
        assert set(zip(np.round(scene.hazards["amplitude"], 2), np.round(scene.hazards["diameter"], 6))) == {
            (abs(height), diameter) for height, diameter in WANTED
        }


def test_labels_are_the_sign_of_the_displacement_beyond_the_limit(ground):
    scene = put_hazards(ground, WANTED, 3, limit=0.07)
    heights = (scene.xyz - ground) @ NORMAL
    near = np.abs(np.abs(heights) - 0.07) < 1e-6
    expected = np.where(np.abs(heights) > 0.07, np.where(heights > 0, 1, 2), 0)
    assert np.array_equal(scene.label[~near], expected[~near])
    assert np.all(scene.hazard[scene.label > 0] >= 0)
    for row in scene.hazards:
        mine = scene.label[(scene.hazard == row["id"]) & (scene.label > 0)]
        assert set(mine) == {row["label"]}
        assert row["points"] == len(mine)
        # 25 points a m²
        assert row["points"] == pytest.approx(25 * row["area"], rel=0.35)
        assert 0.5 < row["size"] / row["diameter"] < 1.1


def test_hazards_keep_apart_and_off_edges_holes_and_sparse_ground(scenes):
    for scene in scenes:
        shapes = [shapely.Polygon(outline(hazard)) for hazard in scene.shapes]
        places = middles(scene)
        for i, one in enumerate(shapes):
            assert all(one.distance(other) >= 1.0 for other in shapes[:i])
            radius = 0.5 * scene.hazards["diameter"][i] * 0.86
            u, w = places[i, :2]
            assert min(u, w, 30 - u, 30 - w) > radius
            assert np.hypot(*(places[i, :2] - HOLE)) > HOLE_RADIUS + radius - 0.3
            assert u + radius < SPARSE + 0.5
            assert np.hypot(*(outline(scene.shapes[i]) - [scene.shapes[i].u, scene.shapes[i].w]).T).max() <= reach(
                scene.shapes[i]
            ) * (1 + 1e-9)


def test_the_same_seed_gives_the_same_cloud_and_another_one_another(ground, scenes):
    again = put_hazards(ground, WANTED, 2)
    assert np.array_equal(again.xyz, scenes[2].xyz)
    assert np.array_equal(again.hazards, scenes[2].hazards)
    firsts = {tuple(np.round(middles(scene)[0, :2], 1)) for scene in scenes}
    assert len(firsts) == len(scenes)


def test_what_finds_no_room_is_left_out(ground):
    scene = put_hazards(ground, [(0.3, 3.0), (0.3, 40.0)], 0)
    assert np.round(scene.hazards["diameter"], 6).tolist() == [3.0]
    none = put_hazards(ground, [(0.3, 3.0)], 0, site=Site(minimum_density=200.0))
    assert len(none.hazards) == 0
    assert np.array_equal(none.xyz, ground)
    assert not none.label.any()


def test_room_is_that_of_the_dense_part_without_its_hole(ground):
    rooms = [room_for(ground, diameter) for diameter in (1.0, 3.0, 5.0)]
    assert all(a > b for a, b in pairwise(rooms))
    for diameter, room in zip((1.0, 3.0), rooms):
        # circles and the metre around them on the dense part; those may reach into sparse ground as far as 4 points
        # a m² are left, and up to a gap beyond edges
        margin = diameter / 2 + 1.0
        least = (SPARSE - 2 * margin) * (30 - 2 * margin) - np.pi * (HOLE_RADIUS + margin) ** 2
        margin = diameter / 2
        most = (SPARSE + margin) * (30 - 2 * margin + 0.5) - np.pi * (HOLE_RADIUS + margin - 0.25) ** 2
        assert least < room < most


@pytest.mark.parametrize("wanted", [(0.0, 3.0), (0.3, 0.0), (float("nan"), 3.0)])
def test_a_hazard_without_height_or_size_is_refused(ground, wanted):
    with pytest.raises(InputError, match="give a height other than 0"):
        put_hazards(ground, [wanted], 0)
