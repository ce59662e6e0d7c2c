"""The direction of a change where it is left to the ground: square to steep faces, upright elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.direction import with_direction
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import ChangeParameters, GridChangeParameters


class Heard(Progress):
    """Keeps what is said."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def info(self, text: str) -> None:
        self.said.append(text)


def face(seed: int, degrees: float) -> np.ndarray:
    """Points of a plane face of 6 by 4 m on the map, with 1 cm of noise in height."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 6, 8000), rng.uniform(0, 4, 8000)
    return np.column_stack([x, y, y * np.tan(np.radians(degrees)) + rng.normal(0, 0.01, 8000)])


@pytest.mark.parametrize(("degrees", "direction"), [(40.0, "vertical"), (60.0, "normal"), (70.0, "normal")])
def test_a_raised_face_is_measured_square_to_itself_where_it_is_steep(degrees, direction):
    heard = Heard()
    first, second = face(1, degrees), face(2, degrees) + [0.0, 0.0, 0.1]
    change = difference(first, second, ChangeParameters(cell=0.25, adaptive=False, calibrate=False), progress=heard)
    expected = 0.1 * (np.cos(np.radians(degrees)) if direction == "normal" else 1.0)
    assert change.direction == direction
    assert np.nanmedian(change.dz) == pytest.approx(expected, abs=0.003)
    assert any("square to the slope" in text for text in heard.said) == (direction == "normal")


def test_a_direction_that_was_asked_for_stays():
    steep = np.full((3, 3), 70.0)
    assert with_direction(GridChangeParameters(direction="vertical"), steep).direction == "vertical"
    assert with_direction(GridChangeParameters(direction="normal"), 0 * steep).direction == "normal"


def test_without_any_known_slope_heights_are_compared():
    assert with_direction(GridChangeParameters(), np.full((2, 2), np.nan)).direction == "vertical"
