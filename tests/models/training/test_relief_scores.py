"""Scores of labelled slopes by zones, counted by hand, and cells as screening lays them out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from slopewatch.models.training.own_data import OwnCloud
from slopewatch.models.training.relief_scores import (
    LabelledRaster,
    ReliefScores,
    Screened,
    ZoneFigures,
    held_out_cells,
    labelled_raster,
    pooled_zones,
    zone_figures,
)


def own_cloud(xyz: np.ndarray, labels: np.ndarray) -> OwnCloud:
    return OwnCloud(Path("own.laz"), xyz, labels.astype(np.uint8), "0" * 64, 6.0)


def test_hazards_and_false_zones_are_those_counted_by_hand() -> None:
    truth = np.zeros((40, 40), dtype=np.uint8)
    decided = np.zeros_like(truth)
    truth[2:6, 2:6] = 1  # 4 m², of which a zone of 1 m² covers just enough
    decided[4:6, 4:6] = 1
    truth[10:14, 2:6] = 2  # touched by 0.75 m² of a larger zone: not found, but the zone is not false
    decided[13:16, 3:6] = 2
    truth[20:24, 2:6] = 1  # said to be the other class: not found, and a false zone
    decided[20:24, 2:6] = 2
    truth[30:31, 2:4] = 1  # 0.5 m² are no hazard
    decided[30:33, 20:23] = 1  # false, on background
    truth[10:14, 20:30] = 255
    decided[10:14, 20:26] = 1  # on ground of unknown class: neither
    decided[2:3, 30:32] = 2  # too small for a zone
    found = zone_figures(decided, truth, 0.5)
    background = np.count_nonzero(truth == 0) / 4
    assert found == ZoneFigures(3, 1, 2, background)
    assert found.summary()["hazard_recall"] == pytest.approx(1 / 3, abs=1e-4)
    assert found.summary()["false_zones_per_1000_m2"] == pytest.approx(2000 / background, abs=1e-3)
    assert ZoneFigures.of(found.summary()) == found
    pooled = pooled_zones(
        [{"zones": found.summary(), "start_zones": None}, {"zones": found.summary(), "start_zones": None}]
    )
    assert (pooled["hazards"], pooled["false_zones"]) == (6, 4)
    assert "start_hazards" not in pooled
    assert ZoneFigures().summary()["hazard_recall"] is None


def test_a_slope_is_laid_out_as_screening_does_and_labels_reach_over_gaps() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.0, 20.0, (1600, 2)) + (500_000.0, 3_500_000.0)
    z = 100.0 + 0.7 * (xy[:, 1] - 3_500_000.0) + rng.normal(0, 0.01, len(xy))
    labels = np.where(xy[:, 0] < 500_010.0, 1, 0)
    labels[:100] = 255
    cloud = own_cloud(np.column_stack([xy, z]), labels)
    raster = labelled_raster(cloud)
    assert raster.cells.cell == 0.5
    assert raster.cells.count.sum() == len(xy)
    count = np.zeros(raster.labels.shape)
    np.add.at(count, (raster.column, raster.row), 1)
    np.testing.assert_array_equal(count, raster.cells.count)
    for cell in rng.permutation(np.argwhere(count > 0))[:60]:
        inside = labels[(raster.column == cell[0]) & (raster.row == cell[1])]
        kinds, votes = np.unique(inside, return_counts=True)
        clear = (votes == votes.max()).sum() == 1
        assert raster.labels[tuple(cell)] == (kinds[votes.argmax()] if clear else 255)
    empty = (count == 0) & (raster.nearby != 255)
    assert empty.sum() > 100
    assert (raster.labels[count == 0] == 255).all()


def test_points_and_held_out_cells_are_scored_with_what_is_said_of_their_cell() -> None:
    shape = (4, 5)
    rng = np.random.default_rng(2)
    labels = rng.choice(np.array([0, 1, 2, 255], dtype=np.uint8), 60)
    column, row = rng.integers(0, 4, 60), rng.integers(0, 5, 60)
    probabilities = rng.dirichlet([1, 1, 1], shape).transpose(2, 0, 1).astype(np.float32)
    decided = rng.integers(0, 3, shape).astype(np.uint8)
    cells = type("Cells", (), {"covered": np.ones(shape, dtype=bool), "cell": 0.5})()
    cell_labels = rng.choice(np.array([0, 1, 2, 255], dtype=np.uint8), shape)
    raster = LabelledRaster(cells, column, row, cell_labels, cell_labels)  # type: ignore[arg-type]
    scores = ReliefScores()
    cloud = own_cloud(np.zeros((60, 3)), labels)
    scores.add(cloud, raster, Screened(decided, probabilities))
    wanted = np.zeros((3, 3), dtype=int)
    for label, i, j in zip(labels, column, row):
        if label != 255:
            wanted[label, decided[i, j]] += 1
    np.testing.assert_array_equal(scores.counts, wanted)
    assert scores.summary()["start_confusion"] is None
    scores.add_start(cloud, raster, Screened(decided, probabilities))
    assert scores.summary()["start_confusion"] == wanted.tolist()
    odds, kinds, weights = held_out_cells(raster, probabilities, 5, np.random.default_rng(1))
    assert odds.shape == (5, 2)
    assert weights.sum() == pytest.approx(np.count_nonzero(cell_labels != 255))
    every, _, _ = held_out_cells(raster, probabilities, 1000, np.random.default_rng(1))
    i, j = np.nonzero(cell_labels != 255)
    expected = np.log(probabilities[1:, i, j] / probabilities[0, i, j]).T
    np.testing.assert_allclose(np.sort(every, axis=0), np.sort(expected, axis=0), rtol=1e-4, atol=1e-5)
    assert set(kinds) <= {0, 1, 2}
