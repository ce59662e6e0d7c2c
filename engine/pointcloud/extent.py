"""The true extent of a cloud file, from all its points, in metres."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from laspy import DecompressionSelection, PackedPointRecord

from ..core.arrays import Float, Index
from ..crs.working_frame import WorkingFrame
from .decoding_check import DecodedBounds
from .header import CloudHeader
from .records import read_records


@dataclass(frozen=True)
class Extent:
    """``low`` and ``high`` (3,) are metres of the working frame; ``warnings`` are sentences about the header."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    warnings: tuple[str, ...]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        return self.low[0], self.low[1], self.high[0], self.high[1]


def square_metres(xyz: Float) -> Index:
    """Numbers of the squares of a metre that points (n, 2+), m, lie in, each once."""
    place = np.floor(xyz[:, :2]).astype(np.int64)
    return np.unique((place[:, 0] << 32) + place[:, 1])


class CheckedRecords:
    """Iterates over the groups of ``read_records`` and watches what they decode to."""

    def __init__(
        self,
        header: CloudHeader,
        selection: DecompressionSelection | None = None,
        starts: Collection[int] | None = None,
    ) -> None:
        """``starts``: see ``read_records``; what the header says of all points is then not compared."""
        self.header, self.done = header, 0
        self._selection, self._starts = selection, starts
        self._bounds = DecodedBounds(header)
        self._warnings: list[str] = []

    def __iter__(self) -> Iterator[PackedPointRecord]:
        groups = read_records(self.header, selection=self._selection, warnings=self._warnings, starts=self._starts)
        for records in groups:
            self._bounds.add(records)
            self.done += len(records)
            yield records

    def extent(self, frame: WorkingFrame | None) -> Extent:
        """The extent once all was read, in metres, or in the file's units without a frame.

        Raises:
            InputError: the points are damaged.
        """
        factors = np.ones(3) if frame is None else np.array(frame.factors)
        scales, offsets = np.array(self.header.scales) * factors, np.array(self.header.offsets) * factors
        low, high = self._bounds.low * scales + offsets, self._bounds.high * scales + offsets
        return Extent(
            (float(low[0]), float(low[1]), float(low[2])),
            (float(high[0]), float(high[1]), float(high[2])),
            (*self._warnings, *self._bounds.finish(whole=self._starts is None)),
        )
