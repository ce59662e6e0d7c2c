"""Corrections of heights against scipy's interpolation, there and back, and through their file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pyproj import CRS
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.height_correction import HeightCorrection, Nodes
from slopewatch.engine.geometry.rigid_transform import BentTransform, RigidTransform

RNG = np.random.default_rng(1)
NODES = Nodes(500_000.0, 3_500_000.0, 20.0, 3, 5)
CORRECTION = HeightCorrection(NODES, RNG.normal(0, 0.03, (3, 5)), np.full((3, 5), 0.002))
POINTS = np.array([500_000.0, 3_500_000.0, 100.0]) + RNG.uniform([0, 0, 0], [80, 40, 20], (500, 3))


def test_between_nodes_the_correction_is_bilinear_and_beyond_them_that_of_the_edge():
    y, x = (start + 20.0 * np.arange(count) for start, count in ((NODES.south, 3), (NODES.west, 5)))
    peer = RegularGridInterpolator((y, x), CORRECTION.heights)
    assert CORRECTION.at(POINTS[:, :2]) == pytest.approx(peer(POINTS[:, [1, 0]]), abs=1e-12)
    corner = np.array([[NODES.west - 50.0, NODES.south - 1.0]])
    assert CORRECTION.at(corner)[0] == pytest.approx(CORRECTION.heights[0, 0])


def test_the_lattice_holds_all_places():
    nodes = Nodes.over(POINTS[:, :2], 7.0)
    low, high = POINTS[:, :2].min(axis=0), POINTS[:, :2].max(axis=0)
    assert (np.array([nodes.west, nodes.south]) <= low).all()
    assert nodes.west + 7.0 * (nodes.columns - 1) >= high[0]
    assert nodes.south + 7.0 * (nodes.rows - 1) >= high[1]


def bent() -> BentTransform:
    turn = Rotation.from_rotvec([2e-4, -1e-4, 3e-4]).as_matrix()
    return BentTransform(turn, np.array([0.1, -0.2, 0.05]), POINTS.mean(axis=0), CORRECTION)


def test_a_bent_transform_is_the_rigid_one_and_then_the_heights():
    transform = bent()
    rigid = RigidTransform.from_matrix(transform.matrix, transform.centre)
    moved = rigid.apply(POINTS)
    moved[:, 2] += CORRECTION.at(moved[:, :2])
    assert np.abs(transform.apply(POINTS) - moved).max() < 1e-8
    assert np.abs(transform.inverse().apply(transform.apply(POINTS)) - POINTS).max() < 1e-8


@pytest.mark.parametrize("backwards", [False, True])
def test_the_file_keeps_matrix_and_pieces(tmp_path, backwards):
    transform = bent().inverse() if backwards else bent()
    transform.save(tmp_path / "transform.json", CRS.from_epsg(32614))
    document = json.loads((tmp_path / "transform.json").read_text())
    assert np.array_equal(document["matrix"], transform.matrix)
    assert document["pieces"]["heights"] == CORRECTION.heights.tolist()
    loaded = RigidTransform.load(tmp_path / "transform.json")
    assert np.abs(loaded.apply(POINTS) - transform.apply(POINTS)).max() == 0


@pytest.mark.parametrize(
    "damage", [{"heights": [[0.0, 1.0]]}, {"spacing": 0.0}, {"west": "here"}, {"heights": [[1.0, float("inf")]] * 3}]
)
def test_damaged_pieces_are_refused(tmp_path, damage):
    path = tmp_path / "transform.json"
    bent().save(path, CRS.from_epsg(32614))
    document = json.loads(path.read_text())
    document["pieces"] |= damage
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"transform\.json"):
        RigidTransform.load(path)
