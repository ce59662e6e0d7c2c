"""One dimension of a cloud file by its name: a field of the point format or an extra one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.messages import shown
from .header import preflight
from .records import extra_dimensions, read_records

_STANDARD = ("classification", "user_data", "point_source_id", "intensity")


def read_dimension(path: Path | str, name: str) -> NDArray[np.generic]:
    """The values of the dimension ``name`` of all points, in the file's order; case does not matter unless two differ
    by it.

    Raises:
        InputError: see ``preflight`` and ``read_records``; there is no such dimension, or it holds no numbers.
    """
    header = preflight(path)
    extra = {d.name: d for d in extra_dimensions(header) if d.descriptor}
    names = (*extra, *_STANDARD)
    found = [n for n in names if n == name] or [n for n in names if n.lower() == name.lower()]
    if not found:
        raise InputError(f"{shown(path)} has no dimension {name}; give one of {', '.join(names)}.")
    chosen = extra.get(found[0])
    if chosen is None:
        return np.concatenate([np.array(records[found[0]]) for records in read_records(header)])
    if chosen.dtype.kind not in "uif":
        raise InputError(f"The dimension {chosen.name} of {shown(path)} holds no single numbers; give another one.")
    return np.concatenate([chosen.values(records).copy() for records in read_records(header)])
