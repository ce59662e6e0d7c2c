"""Rigid motions against exact arithmetic, and transform files that are not what they say."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest
from pyproj import CRS
from scipy.spatial.transform import Rotation
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.rigid_transform import RigidTransform, registration_facts

UTM = np.array([512_345.678, 4_123_456.789, 1_234.5])


def motion(angle: float = 0.01, seed: int = 0) -> RigidTransform:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    rotation = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    return RigidTransform(rotation, rng.uniform(-1, 1, 3), UTM)


def points(n: int = 200) -> np.ndarray:
    return UTM + np.random.default_rng(1).uniform(-100, 100, (n, 3))


def exactly(transform: RigidTransform, point: np.ndarray) -> list[float]:
    """R (x - c) + c + t in rational numbers."""
    r = [[Fraction(float(v)) for v in row] for row in transform.rotation]
    c, t, x = ([Fraction(float(v)) for v in values] for values in (transform.centre, transform.translation, point))
    return [float(sum(r[i][j] * (x[j] - c[j]) for j in range(3)) + c[i] + t[i]) for i in range(3)]


def test_a_motion_loses_no_digits_at_projected_coordinates():
    transform = motion()
    cloud = points(20)
    expected = np.array([exactly(transform, p) for p in cloud])
    assert np.abs(transform.apply(cloud) - expected).max() < 2e-9


def test_the_plain_matrix_gives_the_same_to_a_micrometre():
    transform = motion(0.3)
    cloud = points()
    by_matrix = (np.column_stack([cloud, np.ones(len(cloud))]) @ transform.matrix.T)[:, :3]
    assert np.abs(by_matrix - transform.apply(cloud)).max() < 1e-6


def test_the_inverse_undoes_a_motion():
    there = motion(0.2, 2)
    cloud = points()
    assert np.abs(there.inverse().apply(there.apply(cloud)) - cloud).max() < 1e-8


@pytest.mark.parametrize("angle", [1e-9, 1e-5, 0.3, 3.0])
def test_angle_of_the_rotation_also_where_it_is_tiny(angle):
    assert motion(angle).angle == pytest.approx(angle, rel=1e-6)


def test_saved_and_loaded_it_is_the_same_to_the_last_bit(tmp_path):
    transform = motion()
    transform.save(tmp_path / "t.json", CRS.from_epsg(32651), facts={"rms": 0.01})
    document = json.loads((tmp_path / "t.json").read_text())
    assert document["direction"].startswith("moving to reference")
    assert document["frame"]["crs"] == "EPSG:32651"
    assert np.array_equal(np.array(document["matrix"]), transform.matrix)
    assert np.array_equal(RigidTransform.load(tmp_path / "t.json").apply(points()), transform.apply(points()))


def test_a_bare_matrix_of_another_program_can_be_loaded(tmp_path):
    transform = motion(0.2)
    (tmp_path / "t.json").write_text(json.dumps({"matrix": transform.matrix.tolist()}))
    assert np.abs(RigidTransform.load(tmp_path / "t.json").apply(points()) - transform.apply(points())).max() < 1e-6


SCALED = (np.eye(4) * 1.01).tolist()
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        "not json",
        '{"matrix": 3}',
        '{"matrix": [[1, 0], [0, 1]]}',
        json.dumps({"matrix": SCALED}),
        json.dumps({"matrix": MIRRORED}),
        json.dumps({"matrix": [*np.eye(4).tolist()[:3], [0, 0, 1, 1]]}),
        '{"matrix": [[NaN,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}',
        json.dumps(
            {
                "matrix": np.eye(4).tolist(),
                "rotation": np.eye(3).tolist(),
                "translation": [1, 0, 0],
                "centre": [0, 0, 0],
            }
        ),
    ],
)
def test_files_that_hold_no_rigid_motion_are_refused(tmp_path, content):
    path = tmp_path / "t.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"t\.json"):
        RigidTransform.load(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.json"):
        RigidTransform.load(tmp_path / "none.json")


def test_a_word_that_stands_for_no_number_is_no_figure_of_a_registration(tmp_path) -> None:
    path = tmp_path / "transform.json"
    facts = {"registration_error_m": 0.01, "registration_rmse_m": "nan", "registration_method": "robust"}
    RigidTransform(np.eye(3), np.zeros(3), np.zeros(3)).save(path, CRS.from_epsg(32651), facts)
    assert registration_facts(path) == {"registration_error_m": 0.01, "registration_method": "robust"}
