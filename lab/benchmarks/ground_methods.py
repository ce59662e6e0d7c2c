"""Ways to find the ground among returns, SlopeWatch's and others', all from coordinates and return numbers alone."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from ...engine.core.arrays import Bool
from ...engine.ground.filtering import ground_mask
from ...engine.pointcloud.pdal_program import find_pdal
from ...interface.parameters import GroundParameters
from .ground_clouds import Seen
from .peers import run_peer, version

SCALE = 0.001
GROUND = 2
CELL_RETURNS, LOWEST_SHARE = 44.0, 0.03
"""Returns of a cell of the lowest-returns method, as 0.25 m hold at 700 a m², and the share of them that is ground."""
DENSE, FINE_CELL = 100.0, 0.25
"""From so many returns a m² on SMRF runs with finer cells too, m."""
FAST_GC = """
import json, pathlib, sys
import laspy, numpy
from fastgc.cli import main
cloud, folder, platform, mask = sys.argv[1:]
main(["--in_path", cloud, "--out_dir", folder, "--sensor_mode", platform, "--workflow", "run", "--products", "FAST_GC"])
found = laspy.read(pathlib.Path(folder) / "FAST_GC" / pathlib.Path(cloud).name)
given = laspy.read(cloud)
if not (numpy.array_equal(found.X, given.X) and numpy.array_equal(found.Y, given.Y)):
    raise SystemExit("the labelled points are not the given ones in their order")
numpy.save(mask, numpy.asarray(found.classification) == 2)
print(json.dumps({}))
"""


@dataclass(frozen=True)
class Method:
    """``find`` gives the ground (n,) among what is seen; ``rival``: its mean height is to be undercut.

    ``slow`` ones run in parallel with the others; ``dense_only`` ones on dense clouds alone.
    """

    name: str
    find: Callable[[Seen], Bool]
    rival: bool = True
    slow: bool = False
    dense_only: bool = False

    def suits(self, seen: Seen) -> bool:
        return not self.dense_only or seen.density >= DENSE


def slopewatch(seen: Seen) -> Bool:
    """SlopeWatch at its defaults."""
    return ground_mask(seen.xyz, GroundParameters(), seen.last)


def published(seen: Seen) -> Bool:
    """Profile ``paper``: the Cloth Simulation Filter alone, at the published settings."""
    return ground_mask(seen.xyz, GroundParameters.build(profile="paper"), seen.last)


def smrf(seen: Seen, **options: Any) -> Bool:
    """PDAL's filters.smrf (Pingel et al. 2013): of last returns, as it does by default."""
    with tempfile.TemporaryDirectory() as name:
        given, labelled = Path(name) / "given.las", Path(name) / "labelled.las"
        write_las(given, seen)
        find_pdal().run(
            [
                {"type": "readers.las", "filename": str(given)},
                {"type": "filters.smrf", **options},
                {"type": "writers.las", "filename": str(labelled), "minor_version": 4, "forward": "all"},
            ]
        )
        return _labelled(laspy.read(labelled), laspy.read(given))


def fast_gc(seen: Seen) -> Bool:
    """FAST-GC at its program's defaults for the cloud's platform, in an environment of its own.

    Raises:
        PeerMissingError: it cannot be installed.
    """
    with tempfile.TemporaryDirectory() as name:
        given, mask = Path(name) / "given.las", Path(name) / "mask.npy"
        write_las(given, seen)
        run_peer("fastgc", FAST_GC, str(given), str(Path(name) / "found"), seen.platform, str(mask))
        return np.asarray(np.load(mask), dtype=np.bool_)


def lowest_returns(seen: Seen) -> Bool:
    """The lowest 3 %, one at least, of square cells in which about 44 returns lie: 0.25 m at 700 returns a m²."""
    side = float(np.sqrt(CELL_RETURNS / seen.density))
    place = np.floor((seen.xyz[:, :2] - seen.xyz[:, :2].min(axis=0)) / side).astype(np.int64)
    _, cell, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    cell = cell.ravel()
    order = np.lexsort((seen.xyz[:, 2], cell))
    rank = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
    found = np.zeros(len(order), dtype=bool)
    found[order] = rank < np.maximum(1, (LOWEST_SHARE * count).astype(np.int64))[cell[order]]
    return found


def write_las(path: Path, seen: Seen) -> None:
    """What is seen as a LAS file of millimetres, in which no point has a class."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, SCALE), np.floor(seen.xyz.min(axis=0))
    las = laspy.LasData(header)
    las.xyz = seen.xyz
    las.return_number, las.number_of_returns = seen.number, seen.total
    las.write(path)


def _labelled(labelled: laspy.LasData, given: laspy.LasData) -> Bool:
    """Class 2 of a file that must hold the points of another in their order."""
    if not (np.array_equal(labelled.X, given.X) and np.array_equal(labelled.Y, given.Y)):
        raise RuntimeError("the labelled points are not the given ones in their order")
    return np.asarray(labelled.classification) == GROUND


def peers() -> tuple[Method, ...]:
    """The methods that SlopeWatch is compared with."""
    pdal = f"PDAL {find_pdal().version}"
    return (
        Method("CSF (profile paper)", published, slow=True),
        Method(f"SMRF ({pdal}, its defaults)", smrf),
        Method(f"SMRF ({pdal}, cells of {FINE_CELL:g} m)", lambda seen: smrf(seen, cell=FINE_CELL), dense_only=True),
        Method("lowest returns", lowest_returns),
        Method(f"FAST-GC {version('fastgc')}", fast_gc, rival=False),
    )
