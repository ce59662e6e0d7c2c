"""A bounded sample of a cloud that is read in parts: which points are in it depends on their number alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Thinning:
    """Keeps every point, then every second, every fourth and so on, as soon as more than ``limit`` are held."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.seen = 0
        self._step = 1
        self._parts: list[NDArray[np.generic]] = []
        self._held = 0

    def add(self, rows: NDArray[np.generic]) -> None:
        """Offer the next rows (n, ...)."""
        first = -self.seen % self._step
        self.seen += len(rows)
        chosen = rows[first :: self._step].copy()
        self._parts.append(chosen)
        self._held += len(chosen)
        while self._held > self.limit:
            # What is held are the rows 0, step, 2 step...: every second of these is the sample of twice the step.
            self._parts = [np.concatenate(self._parts)[::2].copy()]
            self._held = len(self._parts[0])
            self._step *= 2

    def rows(self) -> NDArray[np.generic]:
        """The sample, in the order of the cloud.

        Raises:
            ValueError: nothing was offered.
        """
        return np.concatenate(self._parts)
