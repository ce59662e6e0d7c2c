"""A slab's top is ground up to its edge; a hedge's top is not, because returns among it reach the ground."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.filtering import ground_mask
from slopewatch.engine.ground.sheet_edges import to_edges

SIDE_M, SLAB_M = 40.0, 6.0
LIMITS = 0.04, 0.1
"""Scatter of bare ground and distance of ground from its surface, m."""


@pytest.mark.parametrize("returns", [12, 40])
def test_the_top_of_a_slab_is_ground_up_to_its_edge(returns):
    """The lowest returns of cells left 30 to 40 % of a slab 4 m wide; most of the last 0.4 m was lost."""
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, SIDE_M, (round(returns * SIDE_M**2), 2))
    inside = SLAB_M / 2 - np.abs(xy - SIDE_M / 2).max(axis=1)
    top = np.where(inside > 0, 0.5, 0.0)
    found = ground_mask(np.column_stack([xy, 0.4 * xy[:, 1] + top + rng.normal(0.0, 0.02, len(xy))]))
    assert found[(inside > 0) & (inside < 0.4)].mean() > 0.6
    assert found[inside > 0].mean() > 0.85
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
