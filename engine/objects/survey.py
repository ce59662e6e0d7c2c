"""All returns of a survey, thinned to the resolution at which objects are looked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection as Fields

from ...interface.parameters import InputParameters
from ..core.arrays import Bool, Float, Index
from ..geometry.columns import greatest, least
from ..geometry.point_spacing import point_spacing
from ..geometry.rigid_transform import RigidTransform
from ..ground.pdal_pipelines import GROUND
from ..pointcloud.reading import open_cloud
from ..pointcloud.records import PLACES, coordinates, read_records
from ..pointcloud.returns import ReturnCounts, are_last, returns_of

VOXEL_M = 0.2
"""One return is kept in each voxel of this side: about 20 on the top of an object 1 m wide."""
MAX_POINTS = 6_000_000
"""Returns up to which voxels stay that small."""


@dataclass(frozen=True)
class Survey:
    """Returns ``xyz`` (n, 3), m, which of them are ``ground`` (n,), and which are the last of their pulse (n,).

    All are ``last`` if the file has no return numbers that can be believed.
    """

    xyz: Float
    ground: Bool
    last: Bool

    def __len__(self) -> int:
        return len(self.xyz)

    @cached_property
    def spacing(self) -> float:
        """Mean distance (m) between neighbours, seen from above."""
        return point_spacing(self.xyz[:, :2])

    def thinned(self, side: float) -> Survey:
        """The first return in each voxel of ``side`` m, in their order."""
        if not len(self):
            return self
        low = np.floor(least(self.xyz) / side)
        place = (np.floor(self.xyz / side) - low).astype(np.int64)
        spans = greatest(place) + 1
        key = (place[:, 0] * int(spans[1]) + place[:, 1]) * int(spans[2]) + place[:, 2]
        return self.part(np.sort(np.unique(key, return_index=True)[1]))

    def part(self, index: Index) -> Survey:
        return Survey(self.xyz[index], self.ground[index], self.last[index])


def read_survey(path: Path, transform: RigidTransform | None = None, inputs: InputParameters | None = None) -> Survey:
    """The returns of a cloud with classes, moved by ``transform``.

    Raises:
        InputError: see ``open_cloud``; damaged points.
    """
    header, frame = open_cloud(path, inputs)
    counts, side, parts = ReturnCounts(), VOXEL_M, []
    for records in read_records(header, selection=PLACES | Fields.CLASSIFICATION):
        number, total = np.array(records["return_number"]), np.array(records["number_of_returns"])
        counts = counts.with_more(number, total)
        xyz = coordinates(records, header, frame.factors)
        xyz = xyz if transform is None else transform.apply(xyz)
        parts.append(Survey(xyz, np.array(records["classification"]) == GROUND, are_last(number, total)).thinned(side))
        if sum(map(len, parts)) > MAX_POINTS:
            parts = [_joined(parts).thinned(side)]
            while len(parts[0]) > MAX_POINTS:
                side *= 2.0
                parts = [parts[0].thinned(side)]
    held = _joined(parts).thinned(side)
    return held if returns_of(counts).usable else replace(held, last=np.ones(len(held), dtype=bool))


def _joined(parts: list[Survey]) -> Survey:
    nothing = Survey(np.empty((0, 3)), np.empty(0, dtype=bool), np.empty(0, dtype=bool))
    columns = zip(*((part.xyz, part.ground, part.last) for part in (nothing, *parts)), strict=True)
    return Survey(*(np.concatenate(column) for column in columns))
