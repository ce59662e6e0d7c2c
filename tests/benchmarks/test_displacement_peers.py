"""Plain correlation and patch-wise ICP find a known shift, so that their errors are theirs."""

from __future__ import annotations

import numpy as np
from slopewatch.benchmarks.displacement_peers import still_by_others
from slopewatch.benchmarks.displacement_scenes import bare_pair
from slopewatch.engine.displacement.facets import find_facets


def test_both_find_a_known_shift_across_and_along_the_dip():
    first, later = bare_pair(9, 60.0)
    along, across, _ = find_facets(first).frames[0].axes
    errors = still_by_others(first, later + 0.2 * along - 0.1 * across)
    assert set(errors) == {"plain correlation", "patch-wise ICP"}
    for found in errors.values():
        assert len(found) >= 9
        np.testing.assert_allclose(np.median(found, axis=0), [-0.1, 0.2], atol=0.03)
