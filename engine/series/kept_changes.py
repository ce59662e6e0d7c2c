"""The changes of a series: one is in memory at a time, the others lie on the disk without their empty cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, overload

import numpy as np

from ..change.result import Change
from ..core.arrays import Index
from ..grid.plant_cells import PlantCells

_PLANTS = "plants_"


@dataclass(frozen=True)
class _Kept:
    """A change without its arrays, and the file that holds these."""

    rest: Change
    file: Path


class KeptChanges(Sequence[Change]):
    """Changes in the order in which they were added, each read anew whenever it is asked for."""

    def __init__(self, folder: Path, name: str) -> None:
        """``name`` is that of the files in ``folder``, which is made."""
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._name = folder, name
        self._kept: list[_Kept] = []

    def add(self, change: Change) -> None:
        """Keep a change of cells of one size on the whole grid."""
        file = self._folder / f"{self._name}_{len(self._kept)}.npz"
        cells = np.flatnonzero((change.count_from > 0) | (change.count_to > 0) | np.isfinite(change.dz))
        arrays: dict[str, Any] = {name: array.ravel()[cells] for name, array in _arrays(change).items()}
        with file.open("wb") as stream:
            np.savez(stream, cells=cells, **arrays)
        nothing: dict[str, Any] = {name: np.zeros(0) for name in arrays if not name.startswith(_PLANTS)}
        self._kept.append(_Kept(replace(change, **nothing, plants=None), file))

    def again(self, other: KeptChanges, number: int) -> None:
        """Keep a change that another series of them keeps."""
        self._kept.append(other._kept[number])

    def __len__(self) -> int:
        return len(self._kept)

    @overload
    def __getitem__(self, index: int) -> Change: ...

    @overload
    def __getitem__(self, index: slice) -> list[Change]: ...

    def __getitem__(self, index: int | slice) -> Change | list[Change]:
        if isinstance(index, slice):
            return [_read(kept) for kept in self._kept[index]]
        return _read(self._kept[index])

    def __iter__(self) -> Iterator[Change]:
        return (_read(kept) for kept in self._kept)


def _arrays(change: Change) -> dict[str, np.ndarray]:
    """Those of all cells (rows, columns), by name."""
    assert change.own_points is None
    assert change.layout.listed is None
    found = {f.name: getattr(change, f.name) for f in fields(change)}
    if change.plants is not None:
        found |= {_PLANTS + f.name: getattr(change.plants, f.name) for f in fields(change.plants)}
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


def _read(kept: _Kept) -> Change:
    with np.load(kept.file, allow_pickle=False) as stored:
        cells = stored["cells"]
        arrays = {
            name: _laid_out(cells, stored[name], kept.rest.grid.shape) for name in stored.files if name != "cells"
        }
    plants = {name.removeprefix(_PLANTS): array for name, array in arrays.items() if name.startswith(_PLANTS)}
    own: dict[str, Any] = {name: array for name, array in arrays.items() if not name.startswith(_PLANTS)}
    return replace(kept.rest, **own, plants=PlantCells(**plants) if plants else None)


def _laid_out(cells: Index, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    whole = np.full(shape, np.nan if values.dtype.kind == "f" else 0, dtype=values.dtype)
    whole.ravel()[cells] = values
    return whole
