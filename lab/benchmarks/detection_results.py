"""What became of each simulated pair of the detection benchmark, and the CSV file that keeps it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

FOUND = 0.5
"""A change is found if zones of its sign hold this share of its measured cells beyond half of its height."""
COLUMNS = (
    "cells", "pair", "vegetation", "record", "height_m", "area_m2", "level_m", "share", "low_m3", "high_m3", "true_m3",
    "zones", "beyond",
)  # fmt: skip
"""``record`` is ``pair`` (zones, beyond), ``change`` (height, area, level, share), ``volume`` (low, high, true) or
``false`` (height, area, level of a false zone); a pair without a ``change`` is an unchanged one."""


@dataclass(frozen=True)
class Detected:
    """A known change: peak height and area, the median level of detection on it (m), the share of its core in zones
    of its sign, and the vegetation cover of its pair.
    """

    amplitude: float
    area: float
    level: float
    share: float
    vegetation: float

    @property
    def ratio(self) -> float:
        return abs(self.amplitude) / self.level

    @property
    def found(self) -> bool:
        return self.share >= FOUND


@dataclass(frozen=True)
class Volume:
    """A zone's 95 % interval (m³) and the volume of the one known change that it shows, all of it."""

    low: float
    high: float
    true: float

    @property
    def covered(self) -> bool:
        return self.low <= self.true <= self.high


@dataclass(frozen=True)
class FalseZone:
    """A zone where nothing moved: its change (95th percentile of magnitudes, signed), area, median level (m, m²)."""

    amplitude: float
    area: float
    level: float

    @property
    def ratio(self) -> float:
        return abs(self.amplitude) / self.level


@dataclass(frozen=True)
class PairResult:
    """What became of one pair: ``beyond`` is the share of unchanged cells beyond their level. ``volumes`` holds the
    zones that show one change alone, which no other zone shows.
    """

    changes: tuple[Detected, ...]
    volumes: tuple[Volume, ...]
    false_zones: tuple[FalseZone, ...]
    zones: int
    beyond: float
    vegetation: float

    @property
    def changed(self) -> bool:
        return bool(self.changes)


def write_results(path: Path, results: dict[str, list[PairResult]]) -> None:
    """Keep the results by kind of cells, one line a pair, change, volume and false zone (``COLUMNS``)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        table.writeheader()
        for cells, pairs in results.items():
            for number, pair in enumerate(pairs):
                for record, values in _records(pair):
                    head = {"cells": cells, "pair": number, "vegetation": pair.vegetation, "record": record}
                    table.writerow(head | {k: f"{v:.6g}" for k, v in values.items()})


def _records(pair: PairResult) -> list[tuple[str, dict[str, float]]]:
    return [
        ("pair", {"zones": pair.zones, "beyond": pair.beyond}),
        *(
            ("change", {"height_m": c.amplitude, "area_m2": c.area, "level_m": c.level, "share": c.share})
            for c in pair.changes
        ),
        *(("volume", {"low_m3": v.low, "high_m3": v.high, "true_m3": v.true}) for v in pair.volumes),
        *(("false", {"height_m": z.amplitude, "area_m2": z.area, "level_m": z.level}) for z in pair.false_zones),
    ]


def read_results(path: Path) -> dict[str, list[PairResult]]:
    """The results that ``write_results`` kept."""
    lines: dict[str, dict[int, list[dict[str, str]]]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            lines.setdefault(line["cells"], {}).setdefault(int(line["pair"]), []).append(line)
    return {cells: [_pair(own) for own in pairs.values()] for cells, pairs in lines.items()}


def _pair(lines: list[dict[str, str]]) -> PairResult:
    def values(record: str, *columns: str) -> list[tuple[float, ...]]:
        return [tuple(float(line[c]) for c in columns) for line in lines if line["record"] == record]

    ((zones, beyond, vegetation),) = values("pair", "zones", "beyond", "vegetation")
    return PairResult(
        changes=tuple(Detected(*v) for v in values("change", "height_m", "area_m2", "level_m", "share", "vegetation")),
        volumes=tuple(Volume(*v) for v in values("volume", "low_m3", "high_m3", "true_m3")),
        false_zones=tuple(FalseZone(*v) for v in values("false", "height_m", "area_m2", "level_m")),
        zones=int(zones),
        beyond=beyond,
        vegetation=vegetation,
    )
