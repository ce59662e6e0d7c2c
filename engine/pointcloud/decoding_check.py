"""Were the points decoded as they were written? The header's box and its numbers of returns are the witnesses.

LAZ carries no check sum. After a flipped bit the decoder runs on and its points stray; points that leave the header's
box far, or leave it while the returns miscount too, are taken for damage. The first point of a chunk is stored as it
is: where most of these lie outside as well, it is the header that is wrong.
"""

from __future__ import annotations

import numpy as np
from laspy import PackedPointRecord
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.messages import shown
from .header import CloudHeader


class DecodedBounds:
    """Gathers the extent of the decoded records; see ``finish``."""

    def __init__(self, header: CloudHeader) -> None:
        self._header = header
        self._scales, self._offsets = np.array(header.scales), np.array(header.offsets)
        self.low, self.high = np.full(3, 2**31), np.full(3, -(2**31))
        self.returns = np.zeros(16, np.int64)
        self._outside = self._far = self._starts = self._starts_outside = 0
        if header.bounds_trusted:
            low, high = np.array(header.bounds_low), np.array(header.bounds_high)
            size = np.maximum(high - low, 1000 * self._scales)
            # Writers round the box by up to a step.
            self._box = self._steps(low) - 2, self._steps(high) + 2
            self._wide = self._steps(low - size), self._steps(high + size)

    def add(self, records: PackedPointRecord) -> None:
        """Take in a group of records that starts with a chunk."""
        low = np.array([records[field].min() for field in "XYZ"], dtype=np.int64)
        high = np.array([records[field].max() for field in "XYZ"], dtype=np.int64)
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.returns += np.bincount(records["return_number"], minlength=16)
        if not self._header.bounds_trusted:
            return
        layout = self._header.laz
        chunk = layout.chunk_size if layout is not None and layout.chunk_size else len(records)
        self._starts += len(records[::chunk])
        if (low < self._box[0]).any() or (high > self._box[1]).any():
            self._outside += int(np.count_nonzero(_beyond(records, *self._box)))
            self._far += int(np.count_nonzero(_beyond(records, *self._wide)))
            self._starts_outside += int(np.count_nonzero(_beyond(records[::chunk], *self._box)))

    def finish(self, *, whole: bool = True) -> list[str]:
        """Warnings about the header.

        Args:
            whole: all points were added, so that what the header says of all can be compared.

        Raises:
            InputError: the compressed points are damaged.
        """
        name, header = shown(self._header.path), self._header
        known = header.points_by_return
        uncounted = 0 < int(self.returns[0]) == int(self.returns.sum())
        told = any(known) and any(n != int(m) for n, m in zip(known, self.returns[1:], strict=False))
        miscounted = whole and not uncounted and told
        header_holds = 2 * self._starts_outside < self._starts
        if header.compressed and self._outside and header_holds and (self._far or miscounted):
            raise InputError(
                f"{name} is damaged: {self._outside} of its {header.count} points decode to places outside of the "
                "bounding box in its header; copy it again from its source."
            )
        warnings: list[str] = []
        if self._outside:
            warnings.append(
                f"{name} has {self._outside} of its {header.count} points outside of the bounding box in its header; "
                "the box is computed from the points."
            )
        elif whole and header.bounds_trusted and self._slack() > 1.0:
            warnings.append(
                f"{name} says in its header a bounding box that is larger than its points by {self._slack():.1f} "
                "units; the box is computed from the points."
            )
        if uncounted:
            warnings.append(f"{name} has no return numbers (all are 0); every point is taken as a pulse's only return.")
        elif miscounted:
            warnings.append(
                f"{name} says in its header other numbers of returns than its points have; its header was not updated "
                "or its points are damaged."
            )
        return warnings

    def _slack(self) -> float:
        """How far the header's box reaches beyond the points, where that is over 1 % of it."""
        low = np.array(self._header.bounds_low)
        high = np.array(self._header.bounds_high)
        gap = np.maximum(self.low * self._scales + self._offsets - low, high - self.high * self._scales - self._offsets)
        return float(np.max(np.where(gap > 0.01 * (high - low), gap, 0.0)))

    def _steps(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.rint((values - self._offsets) / self._scales)


def _beyond(records: PackedPointRecord, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.bool_]:
    outside = np.zeros(len(records), bool)
    for axis, field in enumerate("XYZ"):
        outside |= (records[field] < low[axis]) | (records[field] > high[axis])
    return outside
