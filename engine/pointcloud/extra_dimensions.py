"""One dimension of a cloud file by its name: a field of the point format or an extra one."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.messages import shown
from .header import POINT_SIZES, CloudHeader, preflight
from .laz_writer import ExtraDimension, extra_fields, read_dimensions
from .records import classes, read_records, record_dtype

_STANDARD = ("classification", "user_data", "point_source_id", "intensity")
_SCALED, _OFFSET = 8, 16  # bits of an extra dimension's options: its values are scaled, and have an offset


def dimension_names(header: CloudHeader) -> tuple[str, ...]:
    """The extra dimensions of a file, and the fields of its points that can be read by name."""
    return (*(d.name for d in _extra(header) if d.descriptor), *_STANDARD)


def read_dimension(path: Path | str, name: str) -> NDArray[np.generic]:
    """The values of the dimension ``name`` of all points, in the file's order; case does not matter unless two differ
    by it.

    Raises:
        InputError: see ``preflight`` and ``read_records``; there is no such dimension, or it holds no numbers.
    """
    header = preflight(path)
    names = dimension_names(header)
    found = [n for n in names if n == name] or [n for n in names if n.lower() == name.lower()]
    if not found:
        raise InputError(f"{shown(path)} has no dimension {name}; give one of {', '.join(names)}.")
    extra = {d.name: d for d in _extra(header)}
    chosen = extra.get(found[0])
    parts: list[NDArray[np.generic]] = []
    if chosen is None:
        for records in read_records(header):
            is_class = found[0] == "classification"
            parts.append((classes(records, header.point_format) if is_class else records[found[0]]).copy())
        return np.concatenate(parts)
    if chosen.dtype.kind not in "uif":
        raise InputError(f"The dimension {chosen.name} of {shown(path)} holds no single numbers; give another one.")
    standard = record_dtype(header.point_format, POINT_SIZES[header.point_format])
    dtype = np.dtype(standard.descr + extra_fields(list(extra.values())))
    for records in read_records(header):
        parts.append(records.view(dtype)[f"extra:{chosen.name}"].copy())
    return _scaled(np.concatenate(parts), chosen.descriptor)


class ExtraNumbers:
    """Extra dimensions of single numbers, told from a file's records group by group.

    ``found`` are those of the ``names`` asked for that the file has.
    """

    def __init__(self, header: CloudHeader, names: tuple[str, ...]) -> None:
        own = _extra(header)
        self._chosen = {d.name: d for d in own if d.name in names and d.dtype.kind in "uif"}
        standard = record_dtype(header.point_format, POINT_SIZES[header.point_format])
        self._dtype = np.dtype(standard.descr + extra_fields(own))

    @property
    def found(self) -> tuple[str, ...]:
        return tuple(self._chosen)

    def values(self, records: NDArray[np.void], name: str) -> NDArray[np.generic]:
        """Of one group of the file's records, (n,)."""
        return _scaled(records.view(self._dtype)[f"extra:{name}"], self._chosen[name].descriptor)


def _extra(header: CloudHeader) -> list[ExtraDimension]:
    own = header.record_length - POINT_SIZES[header.point_format]
    return read_dimensions(header.vlrs.get(("LASF_Spec", 4)), own)


def _scaled(values: NDArray[np.generic], descriptor: bytes) -> NDArray[np.generic]:
    """Values as the file means them, where its descriptor (LAS 1.4, R15, table 24) has a scale or an offset."""
    options = descriptor[3]
    if not options & (_SCALED | _OFFSET):
        return values
    result = values.astype(np.float64)
    if options & _SCALED:
        result *= struct.unpack_from("<d", descriptor, 112)[0]
    if options & _OFFSET:
        result += struct.unpack_from("<d", descriptor, 136)[0]
    return result
