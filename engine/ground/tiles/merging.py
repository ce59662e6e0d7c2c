"""Points to tiles and back: what tiles found of each point, in the order of the file, and the clouds written by it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from laspy import PackedPointRecord
from numpy.typing import NDArray

from ....interface.parameters import GroundParameters
from ...core.arrays import Bool, Float
from ...pointcloud import plant_cover
from ...pointcloud.reading import open_cloud
from ...pointcloud.records import new_dimension
from ...pointcloud.writing import Target, copy_records, put_flags_apart
from ..cover import GroundCover, HeightCounts, facts_of_squares, height_counts, with_more
from ..cover_squares import SUMS, OverGround, finest_squares, square_sums, squares_of
from ..pdal_pipelines import GROUND, UNCLASSIFIED
from ..result import HEIGHT_OVER_GROUND
from ..tally import Tally, square_keys, square_places
from .spool import FOUND, Spool
from .survey import Part, Survey

_ORDER = np.dtype("<i4")
_DIMENSIONS = {HEIGHT_OVER_GROUND: "height", plant_cover.ERROR: "error", plant_cover.HEIGHT: "plants"}
NOWHERE = -1
"""Tile of an outlier."""


@dataclass(frozen=True)
class Merged:
    """``keep`` and ``ground`` (n,) by point of the clipped file; ``found`` holds FOUND records of those kept, in their
    order, ``of_ground`` those of the ground. ``known`` says whether they have heights; then there is a ``cover``.
    """

    keep: Bool
    ground: Bool
    found: Path
    of_ground: Path
    known: bool
    cover: GroundCover | None


def fill(spool: Spool, survey: Survey, parameters: GroundParameters) -> None:
    """Write the points that are kept into their tiles' files, and the tile of each point into one of its own."""
    with _order_file(spool).open("wb") as stream:
        for part in survey.parts():
            flat = survey.flat(part.xyz)
            tile = spool.tiles.of(flat)
            keep = ~survey.denoising.outliers(flat, part.labels)
            tile[~keep] = NOWHERE
            tile.astype(_ORDER).tofile(stream)
            spool.add(tile[keep], flat[keep], survey.taken(part, parameters)[keep])


def merge(spool: Spool, survey: Survey, *, known: bool) -> Merged:
    """What tiles found of each point, in the order of the file.

    Args:
        known: whether tiles found heights over the ground.
    """
    keep, ground = (np.zeros(survey.header.count, dtype=bool) for _ in range(2))
    paths = [spool.folder / f"{name}.bin" for name in ("found", "ground")]
    counter = _CoverCounter(survey.plane.dip) if known else None
    done = 0
    with paths[0].open("wb") as all_kept, paths[1].open("wb") as all_ground:
        for part, chosen, records in _in_order(spool, survey):
            here = slice(done, done + len(chosen))
            keep[here] = chosen
            ground[here][chosen] = records["ground"]
            records.tofile(all_kept)
            records[records["ground"]].tofile(all_ground)
            if counter is not None:
                counter.add(part.xyz[chosen], records)
            done += len(chosen)
    cover = None if counter is None else counter.cover()
    return Merged(keep, ground, paths[0], paths[1], known, cover)


def write_clouds(plain: Path, merged: Merged, outputs: tuple[Path, Path, Path], *, flags_in_class: bool) -> None:
    """Write the clipped, the classified and the ground cloud from the clipped file, which is read once.

    Raises:
        EngineError, InputError: as ``copy_records``.
    """
    header, frame = open_cloud(plain)
    new = [new_dimension(name, np.dtype(np.float32)) for name in _DIMENSIONS] if merged.known else []

    def target(path: Path, keep: Bool, found: Path | None) -> Target:
        def change(records: PackedPointRecord, part: slice) -> None:
            if flags_in_class:
                put_flags_apart(records)
            if found is None:
                return
            values = np.fromfile(found, FOUND, part.stop - part.start, offset=part.start * FOUND.itemsize)
            records["classification"] = np.where(values["ground"], GROUND, UNCLASSIFIED).astype(np.uint8)
            for dimension in new:
                records.array[dimension.field] = values[_DIMENSIONS[dimension.name]]

        dimensions = () if found is None else new
        return Target(path, frame.crs, header.scales, header.offsets, change, dimensions, keep)

    clipped, classified, output = outputs
    copy_records(
        header,
        [
            target(clipped, merged.keep, None),
            target(classified, merged.keep, merged.found),
            target(output, merged.ground, merged.of_ground),
        ],
    )


def _in_order(spool: Spool, survey: Survey) -> Iterator[tuple[Part, Bool, NDArray[Any]]]:
    """Parts of the file, which of their points (n,) were kept, and what tiles found of these (m,).

    A tile's files have its points in the order of the file, so each is read from where the part before ended.
    """
    read, done = np.zeros(len(spool.tiles), dtype=np.int64), 0
    for part in survey.parts():
        tile = np.fromfile(_order_file(spool), _ORDER, len(part.xyz), offset=done * _ORDER.itemsize)
        done += len(tile)
        chosen = tile != NOWHERE
        order = np.argsort(tile[chosen], kind="stable")
        records = np.empty(len(order), FOUND)
        numbers, first = np.unique(tile[chosen][order], return_index=True)
        for number, index in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
            records[index] = spool.load(number, "found", FOUND, int(read[number]), len(index))
            read[number] += len(index)
        yield part, chosen, records


class _CoverCounter:
    """Sums of the cover's finest squares over parts of a cloud whose plane has the inclination ``dip``, degrees."""

    def __init__(self, dip: float) -> None:
        self._squares = Tally(SUMS)
        self._upright = max(math.cos(math.radians(dip)), 0.1)
        self._heights: HeightCounts | None = None

    def add(self, xyz: Float, records: NDArray[Any]) -> None:
        """Count points (n, 3) and what is known of them, FOUND records (n,)."""
        if not len(xyz):
            return
        keys, index = np.unique(square_keys(np.column_stack(finest_squares(xyz))), return_inverse=True)
        height, error, plants = (records[name].astype(np.float64) for name in ("height", "error", "plants"))
        over = OverGround(records["ground"], height, height * self._upright, error, plants)
        self._squares.add_sums(keys, square_sums(index.ravel(), len(keys), over))
        counts = height_counts(height, records["ground"])
        self._heights = counts if self._heights is None else with_more(self._heights, counts)

    def cover(self) -> GroundCover | None:
        """The cover of all points; None without any."""
        if self._heights is None:
            return None
        keys, finest = self._squares.found()
        columns, rows = square_places(keys).T
        cells = squares_of(columns, rows, finest[0])
        sums = np.asarray([np.bincount(cells.index, row, len(cells.side)) for row in finest], dtype=np.float64)
        return facts_of_squares(cells, sums, self._heights)


def _order_file(spool: Spool) -> Path:
    return spool.folder / "order.bin"
