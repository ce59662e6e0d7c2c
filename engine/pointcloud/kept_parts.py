"""What was chosen of a cloud, kept uncompressed on the disk, so that a file is decompressed once however often it is
looked through.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..core.progress import Progress
from .cloud import PointCloud
from .in_parts import CloudFile

_ARRAYS = ("rgb", "intensity", "classification")
_POINT_BYTES = 33  # of a point with all of them


class KeptParts:
    """Parts of a cloud that are added one after the other, and read again in that order."""

    def __init__(self, file: Path) -> None:
        """``file`` is made when the first part is added; it goes with the folder that it is in."""
        self._file = file
        self._counts: list[int] = []
        self._first: PointCloud | None = None
        self._dtype = np.dtype([])

    @staticmethod
    def room(cloud: CloudFile, folder: Path) -> bool:
        """Whether the disk of a folder has room for all points of a cloud, by its header."""
        return cloud.count * _POINT_BYTES < shutil.disk_usage(folder).free / 2

    def add(self, part: PointCloud) -> None:
        """Keep a part; all have the same arrays."""
        known = [name for name in _ARRAYS if getattr(part, name) is not None]
        if self._first is None:
            self._first = part
            arrays = [(name, getattr(part, name)) for name in known]
            self._dtype = np.dtype([("xyz", "<f8", (3,)), *((n, a.dtype, a.shape[1:]) for n, a in arrays)])
        records = np.empty(len(part), self._dtype)
        for name in ("xyz", *known):
            records[name] = getattr(part, name)
        with self._file.open("ab") as stream:
            records.tofile(stream)
        self._counts.append(len(part))

    def parts(self, progress: Progress | None = None) -> Iterator[PointCloud]:
        """The parts as they were added."""
        first, done = self._first, 0
        if first is None:
            return
        with self._file.open("rb") as stream:
            for count in self._counts:
                records = np.fromfile(stream, self._dtype, count)
                arrays: dict[str, Any] = {name: np.ascontiguousarray(records[name]) for name in self._dtype.names or ()}
                yield PointCloud(crs=first.crs, path=first.path, **arrays)
                done += count
                if progress is not None:
                    progress.update(done / max(sum(self._counts), 1))
