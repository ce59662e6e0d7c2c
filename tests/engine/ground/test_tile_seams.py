"""How the heights of adjoining tiles agree, also where one of them knows none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from slopewatch.engine.ground.tiles import surfaces
from slopewatch.engine.ground.tiles.spool import SURFACE


def test_heights_that_one_tile_does_not_know_are_finite_differences():
    theirs = np.zeros(4, SURFACE)
    theirs["height"] = [0.0, 0.1, np.inf, -np.inf]
    spool = SimpleNamespace(load=lambda tile, kind, dtype: theirs)
    places = np.arange(4)
    found = surfaces._seams(spool, [(np.zeros(4, dtype=np.int64), places, np.array([0.0, 0.2, 0.3, 0.4]))])
    assert found.points == 4
    assert found.share_beyond == 0.75
    assert np.isfinite([found.median_m, found.p99_m]).all()
    assert found.median_m > 0.1
