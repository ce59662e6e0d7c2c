"""Writing LAS 1.4, compressed as LAZ: header, records of variable length and points in groups."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import BinaryIO

import lazrs
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError

from ..core.errors import EngineError
from ..core.version import VERSION
from .header import Vector
from .records import return_numbers

_HEADER_SIZE = 375
_WKT_BIT, _STANDARD_TIME_BIT = 16, 1
_TYPES: dict[str, int] = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "u8": 7, "i8": 8, "f4": 9, "f8": 10}
_MAXIMUM_PAYLOAD = 65535


@dataclass(frozen=True)
class ExtraDimension:
    """A field behind a point format's own: its name, numpy type and the 192 bytes that describe it in the file.

    Bytes that nothing describes have an empty descriptor; they must come last.
    """

    name: str
    dtype: np.dtype[np.generic]
    descriptor: bytes


def new_dimension(name: str, dtype: np.dtype[np.generic], description: str = "") -> ExtraDimension:
    """Describe an extra dimension.

    Raises:
        EngineError: a name that is too long, or a type that LAS has not.
    """
    code = _TYPES.get(np.dtype(dtype).newbyteorder("<").str.lstrip("<|"))
    raw = name.encode("utf-8")
    if code is None or not 0 < len(raw) <= 32:
        raise EngineError(f"{name!r} of type {dtype} cannot be a dimension of a LAS file")
    descriptor = struct.pack(
        "<2sBB32s4s24s24s24s24s24s32s", b"", code, 0, raw, b"", b"", b"", b"", b"", b"", description.encode()[:32]
    )
    return ExtraDimension(name, np.dtype(dtype).newbyteorder("<"), descriptor)


def read_dimensions(described: bytes | None, extra_bytes: int) -> list[ExtraDimension]:
    """The extra dimensions of a file from its record ``LASF_Spec`` 4; bytes that it does not describe are the last.

    Args:
        described: payload of the record, 192 bytes for each dimension.
        extra_bytes: bytes of a point record behind the point format's own.
    """
    names = {code: name for name, code in _TYPES.items()}
    dimensions: list[ExtraDimension] = []
    seen: set[str] = set()
    left = extra_bytes
    for start in range(0, len(described or b"") - 191, 192):
        descriptor = (described or b"")[start : start + 192]
        code, options = descriptor[2], descriptor[3]
        name = descriptor[4:36].split(b"\0")[0].decode("utf-8", "replace")
        # 11 to 30 were arrays of two or three values; type 0 is raw bytes, as many as the options say.
        if code in names:
            dtype = np.dtype("<" + names[code])
        elif 11 <= code <= 30:
            dtype = np.dtype(f"V{(2 if code <= 20 else 3) * np.dtype(names[(code - 1) % 10 + 1]).itemsize}")
        else:
            dtype = np.dtype(f"V{max(1, options)}")
        if not name or name in seen or dtype.itemsize > left:
            break
        seen.add(name)
        left -= dtype.itemsize
        dimensions.append(ExtraDimension(name, dtype, descriptor))
    if left:
        dimensions.append(ExtraDimension("undescribed", np.dtype(f"V{left}"), b""))
    return dimensions


def wkt_of(crs: CRS) -> str:
    """WKT 1, which every LAS reader knows; WKT 2 where that cannot say it."""
    try:
        text = crs.to_wkt("WKT1_GDAL")
        if text and CRS.from_wkt(text).equals(crs, ignore_axis_order=True):
            return str(text)
    except CRSError:
        pass
    return str(crs.to_wkt("WKT2_2019"))


class LazWriter:
    """Writes a LAZ file of one point format to a seekable stream; ``close`` completes the header.

    Records are structures as ``las_records.record_dtype`` makes them, with the extra dimensions as named fields.
    """

    def __init__(
        self,
        stream: BinaryIO,
        *,
        point_format: int,
        dtype: np.dtype[np.void],
        dimensions: list[ExtraDimension],
        scales: Vector,
        offsets: Vector,
        crs: CRS,
        standard_time: bool = True,
        file_source: int = 0,
        created: tuple[int, int] = (0, 0),
    ) -> None:
        self._stream, self._format, self._dtype = stream, point_format, dtype
        self._scales, self._offsets = scales, offsets
        self._source, self._created = file_source, created
        self._encoding = _WKT_BIT | (_STANDARD_TIME_BIT if standard_time else 0)
        extra = sum(d.dtype.itemsize for d in dimensions)
        record = lazrs.LazVlr.new_for_compression(point_format, extra)
        vlrs = [("LASF_Projection", 2112, wkt_of(crs).encode() + b"\0")]
        described = b"".join(d.descriptor for d in dimensions)
        if described:
            vlrs.append(("LASF_Spec", 4, described))
        vlrs.append(("laszip encoded", 22204, bytes(record.record_data())))
        packed = b"".join(_vlr(*vlr) for vlr in vlrs)
        self._vlr_count, self._offset = len(vlrs), _HEADER_SIZE + len(packed)
        self._count = 0
        self._returns = np.zeros(16, np.int64)
        self._low, self._high = np.full(3, 2**31), np.full(3, -(2**31))
        stream.write(bytes(_HEADER_SIZE) + packed)
        self._compressor = lazrs.ParLasZipCompressor(stream, record)

    def write(self, records: NDArray[np.void]) -> None:
        """Append records of the writer's structure."""
        if not len(records):
            return
        if records.dtype != self._dtype:
            raise EngineError(f"records of {records.dtype} do not fit a file of {self._dtype}")
        records = np.ascontiguousarray(records)
        self._compressor.compress_many(records.view(np.uint8))
        self._count += len(records)
        self._returns += np.bincount(return_numbers(records, self._format), minlength=16)
        for axis, field in enumerate("XYZ"):
            self._low[axis] = min(self._low[axis], int(records[field].min()))
            self._high[axis] = max(self._high[axis], int(records[field].max()))

    def close(self) -> None:
        """Finish the points and write the header."""
        self._compressor.done()
        self._stream.seek(0)
        self._stream.write(self._header())

    def _header(self) -> bytes:
        legacy = self._format < 6 and self._count < 2**32
        returns = [int(n) for n in self._returns[1:]]
        box: list[float] = []
        for axis in range(3):
            for value in (self._high[axis], self._low[axis]):
                box.append(float(value) * self._scales[axis] + self._offsets[axis] if self._count else 0.0)
        head = struct.pack("<4sHH16sBB", b"LASF", self._source, self._encoding, b"", 1, 4)
        head += struct.pack("<32s32sHH", b"SlopeWatch", f"SlopeWatch {VERSION}".encode(), *self._created)
        head += struct.pack(
            "<HIIBH", _HEADER_SIZE, self._offset, self._vlr_count, self._format | 0x80, self._dtype.itemsize
        )
        head += struct.pack("<I5I", *([self._count, *returns[:5]] if legacy else [0] * 6))
        head += struct.pack("<12d", *self._scales, *self._offsets, *box)
        head += struct.pack("<QQIQ15Q", 0, 0, 0, self._count, *returns)
        return head


def extra_fields(dimensions: list[ExtraDimension]) -> list[tuple[str, np.dtype[np.generic]]]:
    """Fields of a record's structure for extra dimensions, under names that cannot meet the format's own."""
    return [(f"extra:{d.name}", d.dtype) for d in dimensions]


def pack_extra(values: Mapping[str, NDArray[np.generic]], part: slice, records: NDArray[np.void]) -> None:
    """Put arrays of extra dimensions into records."""
    for name, array in values.items():
        records[f"extra:{name}"] = array[part]


def _vlr(user: str, record: int, payload: bytes) -> bytes:
    if len(payload) > _MAXIMUM_PAYLOAD:
        raise EngineError(f"the record {user} {record} of {len(payload)} bytes is too long for a LAS file")
    return struct.pack("<H16sHH32s", 0, user.encode(), record, len(payload), b"") + payload
