"""What ``slopewatch info`` tells, against numbers counted another way."""

from __future__ import annotations

import json

import laspy
import numpy as np
import pytest
from slopewatch.engine.pointcloud.summary import describe_cloud
from slopewatch.interface.parameters import InputParameters


def test_facts_of_a_real_cloud(shared_data):
    path = shared_data / "real" / "ign_tiles" / "alpine_slope.laz"
    facts = json.loads(json.dumps(describe_cloud(path)))
    las = laspy.read(path)
    assert facts["points"] == 9423
    assert facts["points_by_class"]["2"] == 3558
    assert facts["points_by_return"] == {
        str(n): int((las.return_number == n).sum()) for n in np.unique(np.asarray(las.return_number))
    }
    cells = {(int(x), int(y)) for x, y in zip(las.x, las.y, strict=True)}
    assert facts["area"] == len(cells)
    assert facts["density"] == pytest.approx(9423 / len(cells))
    assert facts["z"] == [las.z.min(), las.z.max()]
    assert facts["reference_system"]["epsg"] == 2154
    assert facts["warnings"] == []


def test_feet_are_told_in_metres(shared_data):
    path = shared_data / "real" / "autzen_bmx" / "autzen-bmx-2023.las"
    facts = describe_cloud(path)
    assert facts["z"][1] == pytest.approx(laspy.read(path).z.max() * 0.3048006096)
    assert facts["reference_system"]["metres_per_unit"] == pytest.approx([1, 1, 0.3048006096])
    assert facts["colours"]


def test_a_cloud_without_a_usable_reference_system_is_described(tmp_path, las_file, shared_data):
    facts = describe_cloud(las_file(tmp_path / "a.las", crs=None))
    assert facts["points"] == 2000
    assert facts["area"] is None
    assert any("--crs" in w for w in facts["warnings"])
    wrong = describe_cloud(shared_data / "real" / "lone-star.copc.laz")
    assert any("geocentric" in w for w in wrong["warnings"])
    right = describe_cloud(shared_data / "real" / "lone-star.copc.laz", InputParameters(crs="EPSG:32613"))
    assert right["area"] > 700
    assert not any("geocentric" in w for w in right["warnings"])


def test_coordinates_left_of_and_below_zero_count_in_their_own_cells(tmp_path, las_file):
    def around_zero(las):
        las.header.offsets = [0, 0, 0]
        las.x, las.y = np.linspace(-1.5, 1.5, 2000), np.full(2000, -0.5)

    facts = describe_cloud(las_file(tmp_path / "a.las", change=around_zero))
    assert facts["area"] == 4.0
