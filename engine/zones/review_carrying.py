"""What people entered in earlier zones, carried over to the zones that continue them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd

from ...interface.reviews import REMARKS, REVIEWED, REVIEWER, STATUS
from ..vector.review_fields import LOCATION, ON_ROAD, PLACE_FIELDS, REVIEW_FIELDS, in_words, is_entered
from .matching import match_zones

Entries = dict[str, Any]

_TYPES = {"text": object, "real": np.float64}
_VERDICT = frozenset({STATUS, REVIEWER, REVIEWED})
"""A state, who gave it and when: they stay together."""
_NOBODY = "no zone of these results continues it"
_OTHER_KIND = "only a zone of the other kind lies there now"


@dataclass(frozen=True)
class Carried:
    """Zones with the entries of the earlier ones.

    Attributes:
        frame: the zones given, with entries, and with the columns that people added.
        rest: the earlier zones with entries that nothing continues, with the column ``why_not_carried``.
        count: earlier zones whose entries are in ``frame`` now.
        joined: earlier zones whose entries stand in the remarks of a zone that continues another one before all.
        split: earlier zones with entries that came apart.
    """

    frame: gpd.GeoDataFrame
    rest: gpd.GeoDataFrame
    count: int
    joined: int
    split: int


def carry_reviews(
    old: gpd.GeoDataFrame, new: gpd.GeoDataFrame, own: Collection[str] = (), *, persistent_ids: bool = False
) -> Carried:
    """Give ``new`` what people entered in ``old``; every entry is in ``frame`` or in ``rest`` afterwards.

    Where zones grew together, the earlier zone with most in common gives the state of the review: were that
    taken from a small rejected zone, a large one that nobody looked at would count as rejected. What the others said
    goes into the remarks. Where a zone came apart each part gets its entries and a remark. Where a zone lies by the
    register comes from the first that has it.

    Args:
        old, new: zones with ``zone_id``, ``kind`` and polygons; ``new`` has all of ``REVIEW_FIELDS``.
        own: columns of ``old`` that people added.
        persistent_ids: see ``zone_matching.match_zones``.
    """
    if old.crs is not None and new.crs is not None and old.crs != new.crs:
        old = old.to_crs(new.crs)
    entries = [_entries_of(row, own) for row in old.drop(columns=old.geometry.name).to_dict("records")]
    if not any(entries):
        return Carried(new, old.iloc[:0], 0, 0, 0)
    matches = match_zones(old, new, persistent_ids=persistent_ids)
    names = [_called(row) for row in old.drop(columns=old.geometry.name).to_dict("records")]
    new_names = new["zone_id"].tolist()
    taken: list[Entries] = []
    joined = 0
    for sources in matches.sources:
        taken.append(_joined([entries[i] for i in sources]))
        notes = []
        for i in sources:
            if not entries[i]:
                continue
            if len(matches.heirs[i]) > 1:
                parts = ", ".join(new_names[j] for j in sorted(matches.heirs[i]))
                notes.append(f"{names[i]} came apart into {parts}.")
            unsaid = _unsaid(entries[i], taken[-1])
            if unsaid:
                notes.append(f"Also {names[i]}: {in_words(unsaid)}.")
                joined += 1
        if notes:
            taken[-1]["remarks"] = " ".join(filter(None, [taken[-1].get("remarks", ""), *notes]))
    lost = [i for i, entry in enumerate(entries) if entry and not matches.heirs[i]]
    rest = old.iloc[lost].copy()
    rest["why_not_carried"] = np.array([_OTHER_KIND if matches.met[i] else _NOBODY for i in lost], dtype=object)
    return Carried(
        frame=_filled(new, taken, {name: old[name] for name in own if any(name in e for e in entries)}),
        rest=rest,
        count=sum(bool(e) for e in entries) - len(lost),
        joined=joined,
        split=sum(bool(e) and len(h) > 1 for e, h in zip(entries, matches.heirs, strict=True)),
    )


def _entries_of(row: dict[str, Any], own: Collection[str]) -> Entries:
    """What a person entered in a row; fields by the names that they have here, whatever their case there."""
    found: Entries = {}
    computed = ON_ROAD if is_entered(LOCATION, row.get(LOCATION)) else ()
    for name, value in row.items():
        field = name.lower() if name.lower() in REVIEW_FIELDS else name
        if field not in computed and (field in REVIEW_FIELDS or name in own) and is_entered(field, value):
            found[field] = value.strip() if isinstance(value, str) else value
    for field in (name for name, kind in REVIEW_FIELDS.items() if kind == "real" and name in found):
        try:
            found[field] = float(found[field])
        except ValueError:  # a chainage such as 12+300 in a column that was made anew
            entry = f"{field}: {found.pop(field)}"
            found["remarks"] = f"{found['remarks']}; {entry}" if "remarks" in found else entry
    return found


def _called(row: dict[str, Any]) -> str:
    name, run = (str(row.get(field) or "") for field in ("zone_id", "run_id"))
    return f"{name or 'A zone without id'} of run {run}" if run else name or "A zone without id"


def _joined(sources: Sequence[Entries]) -> Entries:
    """The entries of a zone from those of the zones that it continues, that with most in common first."""
    if not sources:
        return {}
    result: Entries = {name: sources[0][name] for name in (*_VERDICT, REMARKS) if name in sources[0]}
    # the chainages of two zones must not be mixed
    placed = next((s for s in sources if any(name in s for name in PLACE_FIELDS)), {})
    result.update({name: placed[name] for name in PLACE_FIELDS if name in placed})
    for source in sources:
        for name, value in source.items():
            if name not in REVIEW_FIELDS and name not in _VERDICT:
                result.setdefault(name, value)
    return result


def _unsaid(entries: Entries, taken: Entries) -> Entries:
    """Those of ``entries`` that ``taken`` does not hold too; a state goes with who gave it, and when."""
    unsaid = {name for name, value in entries.items() if name != "remarks" and str(taken.get(name)) != str(value)}
    if str(entries.get("remarks", "")) not in str(taken.get("remarks", "")):
        unsaid.add("remarks")
    if unsaid & _VERDICT:
        unsaid |= _VERDICT
    return {name: value for name, value in entries.items() if name in unsaid}


def _filled(new: gpd.GeoDataFrame, taken: Sequence[Entries], own: dict[str, pd.Series]) -> gpd.GeoDataFrame:
    """``new`` with ``taken`` in its fields, and with the columns that people added behind them."""
    columns: dict[str, Any] = {}
    for name, kind in REVIEW_FIELDS.items():
        values = [entry.get(name, given) for entry, given in zip(taken, new[name].tolist(), strict=True)]
        columns[name] = pd.Series(
            [str(v) for v in values] if kind == "text" else values, index=new.index, dtype=_TYPES[kind]
        )
    for name, series in own.items():
        values = [entry.get(name) for entry in taken]
        columns[name] = pd.Series(values, index=new.index, dtype=object).astype(_nullable(series))
    return new.assign(**columns)


def _nullable(series: pd.Series) -> Any:
    """The type of a column that has gaps now."""
    if pd.api.types.is_bool_dtype(series.dtype):
        return "boolean"
    return "Int64" if pd.api.types.is_integer_dtype(series.dtype) else series.dtype
