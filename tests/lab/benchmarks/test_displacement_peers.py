"""Plain correlation and patch-wise ICP find a known shift, so that their errors are theirs."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.displacement.facets import find_facets
from slopewatch.lab.benchmarks.displacement_peers import motion_by_others
from slopewatch.lab.benchmarks.displacement_scenes import bare_pair


def test_both_find_a_known_shift_along_the_dip_and_across_it():
    first, later = bare_pair(9, 60.0)
    along, across, _ = find_facets(first).frames[0].axes
    inner = first[(np.abs(first[:, :2] - first[:, :2].mean(axis=0)) < 5.0).all(axis=1)]
    found = motion_by_others(first, later + 0.2 * along - 0.1 * across, inner[:: len(inner) // 9])
    assert set(found) == {f"{name}, {width} m" for name in ("plain correlation", "patch-wise ICP") for width in (5, 8)}
    for motion in found.values():
        assert len(motion) >= 9
        np.testing.assert_allclose(np.median(motion, axis=0), [0.2, -0.1], atol=0.03)
