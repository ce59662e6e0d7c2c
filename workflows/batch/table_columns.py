"""Columns of tables from values of any kind, as GeoPackages take them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd


def column_of(values: Sequence[Any], kind: str) -> pd.Series:
    """A column of ``kind`` text, integer or real; text is never NULL."""
    known = [None if v is None or (not isinstance(v, str) and pd.isna(v)) else v for v in values]
    if kind == "text":
        return pd.Series(["" if v is None else str(v) for v in known], dtype=object)
    if kind == "integer":
        return pd.Series([pd.NA if v is None else int(v) for v in known], dtype="Int64")
    return pd.Series([np.nan if v is None else float(v) for v in known], dtype=np.float64)
