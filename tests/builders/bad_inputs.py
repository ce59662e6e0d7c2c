"""Bad clouds by their number in the list of bad inputs, made by laspy and ``struct``.

``python bad_inputs.py NUMBER FILE`` writes one, for tests in interpreters without laspy.
"""

from __future__ import annotations

import runpy
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS

X, Y, SIDE = 500_000.0, 3_500_000.0, 12.0
SCALE, OFFSET, BOX, COUNT, RECORDS, FORMAT, LENGTH = 131, 155, 179, 247, 100, 104, 105


def slope(seed: int, points: int = 4000) -> np.ndarray:
    """A slope of 31 degrees with relief, 12 x 12 m."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, SIDE, (2, points))
    z = 50 + 0.6 * v + 0.3 * np.sin(0.9 * u) + 0.25 * np.sin(1.1 * v + 0.4 * u) + rng.normal(0, 0.01, points)
    return np.column_stack([X + u, Y + v, z])


def cloud(
    path: Path, xyz: np.ndarray, crs: object = 32651, change: Callable[[laspy.LasData], None] | None = None
) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz[0]) if len(xyz) else np.zeros(3)
    if crs is not None:
        header.add_crs(CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.classification = np.full(len(xyz), 2, dtype=np.uint8)
    if change is not None:
        change(las)
    las.write(path)
    return path


def sound(path: Path) -> Path:
    """What is not bad: the other epoch."""
    return cloud(path, slope(1))


def _patched(path: Path, place: int, layout: str, *values: object) -> Path:
    import struct

    data = bytearray(cloud(path, slope(2)).read_bytes())
    struct.pack_into("<" + layout, data, place, *values)
    path.write_bytes(data)
    return path


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _cut(path: Path, share: float) -> Path:
    data = cloud(path, slope(2)).read_bytes()
    return _written(path, data[: int(share * len(data))])


def _flipped(path: Path) -> Path:
    """Bits of the compressed points, every 97th byte of their second half."""
    data = bytearray(cloud(path, slope(2)).read_bytes())
    start = int.from_bytes(data[96:100], "little")
    for place in range((start + len(data)) // 2, len(data) - 100, 97):
        data[place] ^= 0x10
    return _written(path, bytes(data))


def _zero_returns(las: laspy.LasData) -> None:
    las.return_number = las.number_of_returns = np.zeros(len(las.x), dtype=np.uint8)


def _with(points: list[list[float]]) -> np.ndarray:
    return np.vstack([slope(2), points])


LAS: dict[int, Callable[[Path], Path]] = {
    1: lambda path: _written(path, b""),
    2: lambda path: _written(path, b"\x89PNG" + bytes(600)),
    3: lambda path: _cut(path, 0.6),
    4: lambda path: _cut(path, 0.6),
    5: _flipped,
    6: lambda path: _patched(path, COUNT, "Q", 5000),
    7: lambda path: _patched(path, COUNT, "Q", 3900),
    8: lambda path: _patched(path, RECORDS, "I", 2**32 - 1),
    9: lambda path: _patched(path, FORMAT, "B", 63),
    10: lambda path: _patched(path, LENGTH, "H", 20),
    11: lambda path: _patched(path, SCALE, "d", 0.0),
    12: lambda path: _patched(path, SCALE + 8, "d", float("nan")),
    13: lambda path: _patched(path, OFFSET + 16, "d", float("inf")),
    14: lambda path: _patched(path, BOX, "6d", 9e5, 1e5, 9e6, 1e6, 1e3, -1e3),
    15: lambda path: _patched(path, SCALE, "3d", 1e300, 1e300, 1e300),
    17: lambda path: cloud(path, _with([[X + 900_000, Y + 900_000, 60.0]])),
    18: lambda path: cloud(path, _with([[X + 6, Y + 6, -500.0], [X + 3, Y + 8, -400.0]])),
    20: lambda path: cloud(path, np.zeros((0, 3))),
    21: lambda path: cloud(path, slope(2)[:1]),
    22: lambda path: cloud(path, np.column_stack([X + np.arange(400) * 0.03, np.full(400, Y), np.full(400, 5.0)])),
    23: lambda path: cloud(path, np.tile(slope(2)[:40], (100, 1))),
    24: lambda path: cloud(path, slope(2), None),
    25: lambda path: cloud(path, slope(2) * [1e-4, 1e-5, 1.0], 4326),
    26: lambda path: cloud(path, slope(2), 32650),
    28: lambda path: cloud(path, slope(2) + [0.0, 0.0, 25.0]),
    29: lambda path: cloud(path, slope(2) + [0.0, 0.0, 0.4]),
    30: lambda path: cloud(path, slope(2) + [500.0, 0.0, 0.0]),
    31: lambda path: cloud(path, slope(2) + [SIDE - 0.3, 0.0, 0.0]),
    32: lambda path: sound(path),
    39: lambda path: cloud(path, slope(2), change=_zero_returns),
    43: lambda path: _beside(cloud(path, slope(2))),
}  # fmt: skip
"""Writers of bad clouds; a case that is not of a cloud has none."""
ENDINGS = {3: ".las", 6: ".las", 7: ".las", 10: ".las"}


def _beside(path: Path) -> Path:
    """An index of another cloud next to it."""
    path.with_suffix(".lax").write_bytes(b"LASX" + bytes(100))
    return path


def bad_cloud(number: int, folder: Path, stem: str = "2025-05-01") -> Path:
    return LAS[number](folder / f"{stem}{ENDINGS.get(number, '.laz')}")


def copied(source: Path, target: Path) -> Path:
    return Path(shutil.copy(source, target))


if __name__ == "__main__":
    runpy.run_path(str(Path(__file__).parents[1] / "conftest.py"))
    LAS[int(sys.argv[1])](Path(sys.argv[2]))
