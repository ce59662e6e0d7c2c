"""The self-test: what it puts in is found where screening can find it, and it leaves the run's own result alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import InputParameters, ScreeningParameters
from slopewatch.models.screening.cloud_file import ScreenedFile
from slopewatch.models.screening.screen import screen_points
from slopewatch.models.screening.self_test import SelfTest, self_test
from slopewatch.models.screening.zones import outline_hazards
from slopewatch.tests.builders.screening_clouds import SOUTH, WEST, screen, write


def plain_slope(side: float = 40.0, density: float = 25.0, noise: float = 0.01) -> np.ndarray:
    """(n, 3) m of a slope without hazards that rises by 30 degrees northwards."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, side, (2, round(density * side**2)))
    z = 50 + y * np.tan(np.radians(30.0)) + rng.normal(0, noise, len(x))
    return np.column_stack([x + WEST, y + SOUTH, z])


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "2024-05-01.laz", plain_slope())


class Listener(Progress):
    def __init__(self) -> None:
        super().__init__()
        self.percents, self.messages = [], []

    def emit(self, percent: float, message: str) -> None:
        self.percents.append(percent)

    def show(self, level: str, message: str) -> None:
        self.messages.append(message)


@pytest.mark.parametrize("method", ["filter", "residual", "relief"])
def test_hazards_far_above_the_noise_are_found_and_others_not(cloud, tmp_path, method):
    progress = Listener()
    done = screen(cloud, tmp_path / "out.laz", method=method, self_test=True, progress=progress)
    figures = done.figures["self_test"]
    by_height = figures["found_by_height"]
    tried = sum(n["of"] for n in by_height.values())
    assert tried >= 10
    assert tried == sum(n["of"] for n in figures["found_by_width"].values())
    high = [by_height[key] for key in ("0.5", "0.8")]
    assert sum(n["found"] for n in high) >= 0.9 * sum(n["of"] for n in high) > 0
    assert figures["false_zones_per_1000_m2"] == pytest.approx(1000 * done.figures["zone_count"] / 1848, rel=0.05)
    record = json.loads(done.outputs["run"].read_text())
    assert record["self_test"].startswith(f"Self-test: of {tried} hazards 2 to 8 m wide")
    assert progress.messages.count(record["self_test"]) == 1
    assert progress.percents == sorted(progress.percents)
    assert done.figures["zone_count"] == screen(cloud, tmp_path / "alone.laz", method=method).figures["zone_count"]


def test_a_threshold_above_all_hazards_finds_none(cloud, tmp_path):
    done = screen(cloud, tmp_path / "out.laz", method="residual", residual_threshold=0.9, self_test=True)
    by_height = done.figures["self_test"]["found_by_height"]
    assert sum(n["of"] for n in by_height.values()) >= 10
    assert sum(n["found"] for n in by_height.values()) == 0


def test_the_same_ground_is_tested_in_the_same_way_and_is_not_changed(cloud):
    parameters = ScreeningParameters(screening_method="filter")
    source = ScreenedFile(cloud, InputParameters(), ground="auto")
    screening = screen_points(source, parameters)
    hazards = outline_hazards(screening, source.frame.crs, parameters)
    first, second = (self_test(source, screening, hazards, parameters, source.progress) for _ in range(2))
    assert first.figures() == second.figures()
    np.testing.assert_array_equal(first.found, second.found)
    np.testing.assert_allclose(np.concatenate(list(source.parts())), read_cloud(cloud).xyz, atol=1e-9)


def test_ground_without_room_is_said_to_have_none():
    nothing = np.empty(0)
    assert "no room" in SelfTest(nothing, nothing, nothing.astype(bool), 3, 500.0).sentence()
    one = SelfTest(np.array([-0.5]), np.array([3.0]), np.array([True]), 3, 1500.0)
    assert one.sentence() == (
        "Self-test: of 1 hazards 2 to 8 m wide that were put into this ground, screening found by height 0.5 m: 1 of "
        "1; on the untouched ground it shows 2.0 zones per 1,000 m², false but for hazards that are there."
    )
