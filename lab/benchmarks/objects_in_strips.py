"""Boulders, walls, cars and heaps put into raw strips of real forests and slopes, through ``inspect`` at its defaults.

Strips of one flight show no change. Each shape is put into the later strip (appeared) and the first one (vanished).
Each pair also runs without objects: whatever is named there is false. A single pair:
``python -m slopewatch.lab.benchmarks.objects_in_strips NAME [SEED ...]``; the names are those of ``changes_in_strips``.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import numpy as np
import shapely

from ...engine.objects.candidates import MIN_HEIGHT_M
from ...engine.objects.evidence import Counts, likelihood_ratio
from ...engine.objects.find import MAX_CHANCE
from ...engine.objects.kinds import UNKNOWN, VEGETATION
from ...engine.objects.table import APPEARED
from .changes_in_strips import NAMES, PAIRS, SIMULATED, SIMULATED_CRS, Paths, Survey, _simulated, _written
from .put_objects import Thing, ended, placed_things
from .table import Row, say
from .watched import exit_of

SEEDS = (1, 2)
GAP_M = 3.0
MIN_FOUND = 0.9


@dataclass(frozen=True)
class Outcome:
    """Of one object: returns on it, and of the other survey below; whether it was found, in a zone or at all (not as
    vegetation), its kind, and volume over the true one.
    """

    thing: Thing
    returns: int
    below: int
    found: bool
    kind: str
    volume: float

    @property
    def countable(self) -> bool:
        """Whether so many returns can show it if nothing else lies there."""
        return likelihood_ratio(Counts(self.returns, 0), Counts(0, self.below)) <= MAX_CHANCE


def rows() -> list[Row]:
    """Of all pairs, real ones first."""
    table: list[Row] = []
    found: dict[str, list[bool]] = {}
    false = 0
    for name in NAMES:
        for wrong, outcomes in _runs(name, (0, *SEEDS)):
            false += wrong
            for one in outcomes:
                if one.countable:
                    found.setdefault(one.thing.shape.kind, []).append(one.found)
    for kind, hits in found.items():
        share = sum(hits) / len(hits)
        table.append(Row(f"{kind}: found", f"{sum(hits)} of {len(hits)}", ">= 90 %", "", share >= MIN_FOUND))
    table.append(Row("false objects that are no vegetation", str(false), "0", "", false == 0))
    return table


def _runs(name: str, seeds: Sequence[int]) -> Iterator[tuple[int, list[Outcome]]]:
    """Named objects that are none, and what became of those put in; none if the data are missing."""
    pair = next((p for p in PAIRS if p.name == name), None)
    if pair is not None and pair.missing:
        return
    first, later, slope = pair.load() if pair else _simulated(SIMULATED[name])
    crs = pair.crs if pair else SIMULATED_CRS
    inner = slope.buffer(-1.0)
    grounds = [s.xyz[s.ground & shapely.contains_xy(inner, *s.xyz[:, :2].T)] for s in (first, later)]
    for seed in seeds:
        random = np.random.default_rng([seed, 34])
        things = placed_things(grounds, random, GAP_M) if seed else []
        pairs, counts = _with_things(things, {True: later, False: first}, slope, random)
        with tempfile.TemporaryDirectory() as folder:
            paths = _written((pairs[False], pairs[True]), slope, crs, Path(folder))
            objects, zones = _found(paths)
        outcomes = [_outcome(*of, objects, zones) for of in zip(things, counts, strict=True)]
        wrong = _false(things, objects)
        say(f"{name}, seed {seed}: {wrong} false, {(objects['kind'] == UNKNOWN).sum()} unknown; {_said(outcomes)}")
        yield wrong, outcomes


def _with_things(
    things: Sequence[Thing], pairs: dict[bool, Survey], slope: shapely.Polygon, random: np.random.Generator
) -> tuple[dict[bool, Survey], list[tuple[int, int]]]:
    """The later (True) and first survey with what appeared or is gone; returns on each, and the other's below it."""
    pairs, counts = dict(pairs), []
    for thing in things:
        before, other = pairs[thing.appeared], pairs[not thing.appeared].xyz
        moved, hit = thing.put_into(before.xyz, random)
        kept = ended(hit, before.number)
        tall = thing.top(moved) > MIN_HEIGHT_M
        on = hit & kept & tall & shapely.contains_xy(slope, *moved[:, :2].T)
        below = (thing.top(other) > MIN_HEIGHT_M) & (np.abs(thing.over(other)) < MIN_HEIGHT_M)
        counts.append((int(np.count_nonzero(on)), int(np.count_nonzero(below))))
        total = np.where(hit, before.number, before.total)
        pairs[thing.appeared] = Survey(moved[kept], before.ground[kept], before.number[kept], total[kept])
    return pairs, counts


def _found(paths: Paths) -> tuple[gpd.GeoDataFrame, gpd.GeoDataFrame]:
    """Objects and zones of a run."""
    dates = f"2024-05-01={paths.first}", f"2024-06-01={paths.second}"
    arguments = ["--epoch", dates[0], "--epoch", dates[1], "--roi", str(paths.roi), "--output-dir", str(paths.results)]
    code, said = exit_of(["inspect", *arguments])
    if code:
        raise RuntimeError(said)
    return tuple(gpd.read_file(paths.results / f"{name}.gpkg", layer=name) for name in ("objects", "zones"))


def _outcome(thing: Thing, counts: tuple[int, int], objects: gpd.GeoDataFrame, zones: gpd.GeoDataFrame) -> Outcome:
    def near(layer: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
        return layer[layer.geometry.distance(shapely.Point(thing.middle[:2])) < 0.6 * thing.reach]

    same = near(objects[((objects["change"] == APPEARED) == thing.appeared) & (objects["kind"] != VEGETATION)])
    if not same.empty:
        largest = same.loc[same["volume_m3"].idxmax()]
        return Outcome(thing, *counts, True, str(largest["kind"]), float(same["volume_m3"].sum()) / thing.volume)
    raised = near(zones[(zones["dz_mean_m"] > 0) == thing.appeared])
    return Outcome(thing, *counts, not raised.empty, "zone", float(raised["vol_net_m3"].abs().sum()) / thing.volume)


def _false(things: Sequence[Thing], objects: gpd.GeoDataFrame) -> int:
    named = objects[~objects["kind"].isin([VEGETATION, UNKNOWN])]
    near = shapely.union_all([shapely.Point(thing.middle[:2]).buffer(thing.reach) for thing in things])
    return int((~named.geometry.intersects(near)).sum())


def _said(outcomes: Sequence[Outcome]) -> str:
    return "; ".join(
        f"{o.thing.shape.kind} {o.thing.shape.length:g} m {'new' if o.thing.appeared else 'gone'} "
        f"({o.returns} returns, {o.below} below) " + (f"{o.kind}, volume x {o.volume:.2f}" if o.found else "not found")
        for o in outcomes
    )


if __name__ == "__main__":
    for _ in _runs(sys.argv[1], [int(seed) for seed in sys.argv[2:]] or (0, *SEEDS)):
        pass
