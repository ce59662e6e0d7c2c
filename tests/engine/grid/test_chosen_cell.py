"""The cell that clouds choose for themselves, and how far cells grow where points are few."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.chosen_cell import CELL_SIDES_M, choose_cell, largest_step, level_step
from slopewatch.interface.parameters import AUTO, ChangeParameters, GridChangeParameters, ParameterError


def slope(density: float, *, side: float = 60.0, seed: int = 1, noise: float = 0.03) -> np.ndarray:
    """A plane of 31 degrees with so many points a m²."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, side, (2, round(density * side**2)))
    return np.column_stack([x, y, 50 + 0.6 * x + rng.normal(0, noise, x.size)])


@pytest.mark.parametrize(("density", "cell"), [(400, 0.1), (100, 0.1), (30, 0.2), (5, 0.5), (1, 1.0), (0.25, 2.0)])
def test_the_cell_is_about_as_large_as_the_points_are_apart(density: float, cell: float) -> None:
    dense = slope(density, side=24.0 if density > 50 else 60.0)
    choice = choose_cell((dense, dense), ChangeParameters())
    assert choice.cell == cell
    assert choice.automatic
    assert f"{cell:g} m" in choice.sentence
    assert cell / math.sqrt(2.6) <= max(1 / math.sqrt(density), CELL_SIDES_M[0]) <= cell * math.sqrt(2.6)


def test_the_sparser_survey_decides_and_a_given_cell_stays() -> None:
    clouds = slope(20), slope(1.5, seed=2)
    assert choose_cell(clouds, GridChangeParameters()).cell == choose_cell(clouds[::-1], ChangeParameters()).cell == 1.0
    given = choose_cell(clouds, ChangeParameters(cell=0.25))
    assert (given.cell, given.automatic) == (0.25, False)
    assert "as given" in given.sentence


def test_the_word_for_what_is_left_to_the_data() -> None:
    parameters = ChangeParameters.build({"cell": AUTO, "largest_cell": 3.0})
    assert (parameters.cell, parameters.largest_cell, parameters.target_level) == (AUTO, 3.0, 0.05)
    assert ChangeParameters(cell=0) == ChangeParameters()
    for value in (0.004, -0.1, "automatic"):
        with pytest.raises(ParameterError, match=r"a number from 0\.005 to 100 m, or auto"):
            ChangeParameters(cell=value)


def test_the_choice_is_told_and_is_part_of_the_result() -> None:
    class Told(Progress):
        said: tuple[str, ...] = ()

        def show(self, level: str, message: str) -> None:
            self.said += (message,)

    told = Told()
    change = difference(slope(5), slope(5, seed=2), ChangeParameters(), progress=told)
    assert change.grid.cell == 0.5
    assert change.choice is not None
    assert change.choice.facts()["chosen"] == AUTO
    assert change.choice.sentence in told.said


def test_steps_to_the_level_and_on_to_where_the_ground_runs_out() -> None:
    assert [level_step(cell, ChangeParameters()) for cell in (0.1, 0.12, 0.25, 0.5, 1.0, 2.0)] == [4, 4, 3, 2, 1, 0]
    assert level_step(0.5, ChangeParameters(largest_cell=1.6)) == 1
    dense, sparse = slope(8), slope(0.7, seed=2)
    assert largest_step(dense, dense, 0.5, ChangeParameters()) == 2
    more = largest_step(dense, sparse, 0.5, ChangeParameters())
    # four points of seven tenths a m² need 2.4 m at the mean, nine squares in ten with as many 4 m
    assert 0.5 * 2**more == 4.0
    assert largest_step(dense, sparse, 0.5, ChangeParameters(largest_cell=2.0)) == 2
    assert largest_step(dense, sparse[:0], 0.5, ChangeParameters()) == 2


@pytest.mark.parametrize("cell", [0.25, 0.5, 1.0, 2.0])
def test_nearly_all_ground_of_sparse_surveys_is_compared_at_every_cell(cell: float) -> None:
    first, second = slope(2.5), slope(2.5, seed=2)
    inside = np.hypot(second[:, 0] - 30, second[:, 1] - 30)
    second[:, 2] += 0.5 * np.exp(-((inside / 5.0) ** 2))
    change = difference(first, second, ChangeParameters(cell=cell))
    assert change.valid.mean() > (0.95 if cell != 1.0 else 0.92)  # sums of cells of 1 m miss some points nearby
    middle = change.grid.rows // 2, change.grid.columns // 2
    assert change.significant[middle]
    assert change.dz[middle] == pytest.approx(0.5, abs=0.12)
    assert change.significant.mean() < 0.12


def test_larger_cells_than_for_the_level_are_only_where_smaller_ones_have_too_few_points() -> None:
    """A thin half (growth to 4 m) does not blur the dense one, whose cells never reach the level."""
    first, second = (
        np.vstack([slope(30, seed=seed, noise=0.5), slope(0.6, seed=seed + 5, noise=0.5) + [60.0, 0.0, 36.0]])
        for seed in (1, 2)
    )
    change = difference(first, second, ChangeParameters(cell=0.5))
    assert change.partition.grown
    dense, thin = change.partition.sizes[:, :110], change.partition.sizes[:, 130:]
    assert np.nanmax(dense) <= 2.0
    assert np.nanmax(thin) >= 4.0
    # of places with 0.6 points a m² in each survey, this share has points of both within a metre
    seen = (1.0 - np.exp(-0.6 * np.pi)) ** 2
    assert seen - 0.15 < np.isfinite(thin).mean() < seen + 0.03
