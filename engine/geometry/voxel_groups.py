"""Groups of points that hang together by voxels."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..core.arrays import Float, Index
from .columns import greatest, least


def groups(places: Float, sides: Float) -> list[Index]:
    """Places (n, 3) that hang together by voxels of three ``sides``, m: indices (m,) of each group."""
    if not len(places):
        return []
    place = np.floor((places - least(places)) / sides).astype(np.int64) + 1
    spans = greatest(place) + 2
    strides = np.array([spans[1] * spans[2], spans[2], 1], dtype=np.int64)
    voxels, of_point = np.unique(place @ strides, return_inverse=True)
    links = [(np.arange(len(voxels)), np.arange(len(voxels)))]
    for step in product((-1, 0, 1), repeat=3):
        if step > (0, 0, 0):
            wanted = voxels + int(np.array(step) @ strides)
            found = np.minimum(np.searchsorted(voxels, wanted), len(voxels) - 1)
            joined = np.flatnonzero(voxels[found] == wanted)
            links.append((joined, found[joined]))
    rows, columns = (np.concatenate(ends) for ends in zip(*links, strict=True))
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(voxels),) * 2)
    label = connected_components(graph, directed=False)[1][of_point.ravel()]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
