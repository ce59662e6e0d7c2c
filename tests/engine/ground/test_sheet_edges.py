"""A slab's top is ground up to its edge; a hedge's top is not, because returns among it reach the ground."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.filtering import ground_mask
from slopewatch.engine.ground.sheet_edges import to_edges

SIDE_M, SLAB_M = 40.0, 6.0
LIMITS = 0.04, 0.1
"""Scatter of bare ground and distance of ground from its surface, m."""


@pytest.mark.parametrize(("returns", "rim", "whole"), [(12, 0.6, 0.85), (40, 0.75, 0.9), (150, 0.9, 0.95)])
def test_the_top_of_a_slab_is_ground_up_to_its_edge(returns, rim, whole):
    """The lowest returns of cells left 30 to 40 % of a slab 4 m wide; most of the last 0.4 m was lost."""
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, SIDE_M, (round(returns * SIDE_M**2), 2))
    inside = SLAB_M / 2 - np.abs(xy - SIDE_M / 2).max(axis=1)
    top = np.where(inside > 0, 0.5, 0.0)
    found = ground_mask(np.column_stack([xy, 0.4 * xy[:, 1] + top + rng.normal(0.0, 0.02, len(xy))]))
    assert found[(inside > 0) & (inside < 0.4)].mean() > rim
    assert found[inside > 0].mean() > whole
    assert found[inside < 0].mean() > 0.97


@pytest.mark.parametrize(("among", "least", "most"), [(False, 0.8, 1.0), (True, 0.0, 0.15)])
def test_a_sheet_ends_at_an_edge_but_not_among_lower_returns(among, least, most):
    """Known up to x = 6 m, its returns go on to 7 m. Lower ones lie beyond that, or are drawn at random."""
    rng = np.random.default_rng(4)
    xy = rng.uniform(0.0, 12.0, (12 * 144, 2))
    known = xy[:, 0] < 6.0
    sheet = known | ((xy[:, 0] < 7.0) if not among else (rng.random(len(xy)) < 0.85))
    over, joined = to_edges(np.where(sheet, 0.5, 0.0) + rng.normal(0.0, 0.02, len(xy)), known, xy, 1.5, LIMITS)
    share = joined[~known & sheet & (xy[:, 0] < 7.0)].mean()
    assert least <= share <= most
    assert not joined[known | ~sheet].any()
    assert np.abs(over[joined]).max(initial=0.0) <= LIMITS[1]


def test_both_sides_of_a_step_are_ground_up_to_it():
    """Both sheets are known up to 0.8 m from a step that runs oblique to the cells, which hold returns of both."""
    rng = np.random.default_rng(6)
    xy = rng.uniform(0.0, 12.0, (100 * 144, 2))
    away = (xy - 6.0) @ [0.8, 0.6]
    height = np.where(away < 0.0, 0.5, 0.0) + rng.normal(0.0, 0.01, len(xy))
    over, joined = to_edges(height, np.abs(away) > 0.8, xy, 0.6, (0.02, 0.06))
    for sheet in (away < 0.0, away > 0.0):
        assert joined[sheet & (np.abs(away) < 0.8)].mean() > 0.9
    assert np.abs(over[joined]).max() <= 0.06
