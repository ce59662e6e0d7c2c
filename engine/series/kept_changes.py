"""The changes of a series: one is in memory at a time, the others lie on the disk without their empty cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, overload

import numpy as np

from ..change.result import Change
from ..core.arrays import Index
from ..grid.partition import Partition
from ..grid.plant_cells import PlantCells

_PLANTS, _SIDE, _BLOCK, _OWN = "plants_", "side_of_parts", "part_of_cell", ("points_from", "points_to")


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
        """Keep a change with arrays of the whole grid."""
        file = self._folder / f"{self._name}_{len(self._kept)}.npz"
        cells = np.flatnonzero((change.count_from > 0) | (change.count_to > 0) | np.isfinite(change.dz))
        arrays: dict[str, Any] = {name: array.ravel()[cells] for name, array in _arrays(change).items()}
        side: dict[str, Any] = {} if change.partition.side is None else {_SIDE: change.partition.side}
        with file.open("wb") as stream:
            np.savez(stream, cells=cells, **side, **arrays)
        nothing: dict[str, Any] = {f.name: np.zeros(0) for f in fields(change) if f.name in arrays}
        partition = Partition(change.partition.shape, change.partition.cell)
        self._kept.append(_Kept(replace(change, **nothing, plants=None, own_points=None, partition=partition), file))

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
    assert change.layout.listed is None
    found = {f.name: getattr(change, f.name) for f in fields(change)}
    if change.plants is not None:
        found |= {_PLANTS + f.name: getattr(change.plants, f.name) for f in fields(change.plants)}
    if change.own_points is not None:
        found |= dict(zip(_OWN, change.own_points, strict=True))
    found[_BLOCK] = change.partition.block
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


def _read(kept: _Kept) -> Change:
    with np.load(kept.file, allow_pickle=False) as stored:
        cells, side = stored["cells"], stored[_SIDE] if _SIDE in stored.files else None
        arrays = {
            name: _laid_out(cells, stored[name], kept.rest.grid.shape, -1 if name == _BLOCK else 0)
            for name in stored.files
            if name not in ("cells", _SIDE)
        }
    partition = replace(kept.rest.partition, block=arrays.pop(_BLOCK, None), side=side)
    own = (arrays.pop(_OWN[0]), arrays.pop(_OWN[1])) if _OWN[0] in arrays else None
    plants = {name.removeprefix(_PLANTS): array for name, array in arrays.items() if name.startswith(_PLANTS)}
    rest: dict[str, Any] = {name: array for name, array in arrays.items() if not name.startswith(_PLANTS)}
    return replace(
        kept.rest, **rest, partition=partition, own_points=own, plants=PlantCells(**plants) if plants else None
    )


def _laid_out(cells: Index, values: np.ndarray, shape: tuple[int, int], empty: int) -> np.ndarray:
    whole = np.full(shape, np.nan if values.dtype.kind == "f" else empty, dtype=values.dtype)
    whole.ravel()[cells] = values
    return whole
