"""Boulders, walls, cars and heaps put into raw strips of real forests and slopes, through ``inspect`` at its defaults.

Strips of one flight show no change. Each shape is put into the later strip (appeared) and the first one (vanished).
Each pair also runs without objects: whatever is named there is false. A single pair:
``python -m slopewatch.benchmarks.objects_in_strips NAME [SEED ...]``; the names are those of ``changes_in_strips``.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import geopandas as gpd
import numpy as np
import shapely

from ..engine.objects.kinds import UNKNOWN, VEGETATION
from ..engine.objects.table import APPEARED
from .changes_in_strips import NAMES, PAIRS, SIMULATED, SIMULATED_CRS, Paths, _simulated, _written
from .put_objects import Thing, placed_things
from .table import Row, say
from .watched import exit_of

SEEDS = (1, 2)
GAP_M = 3.0
MIN_RETURNS = 4
"""An object with fewer returns on it cannot be found, and is counted apart."""
MIN_FOUND = 0.9


@dataclass(frozen=True)
class Outcome:
    """Of one object: returns on it, whether it was found at all (not as vegetation), its kind, and volume over the
    true one.
    """

    thing: Thing
    returns: int
    found: bool
    kind: str
    volume: float


def rows() -> list[Row]:
    """Of all pairs, real ones first."""
    table: list[Row] = []
    found: dict[str, list[bool]] = {}
    false = 0
    for name in NAMES:
        for wrong, outcomes in _runs(name, (0, *SEEDS)):
            false += wrong
            for one in outcomes:
                if one.returns >= MIN_RETURNS:
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
        pairs = {True: later, False: first}
        returns = []
        for thing in things:
            before = pairs[thing.appeared]
            moved = thing.put_into(before.xyz, random)
            inside = shapely.contains_xy(slope, *moved[:, :2].T)
            returns.append(int(np.count_nonzero((moved[:, 2] != before.xyz[:, 2]) & inside)))
            pairs[thing.appeared] = replace(before, xyz=moved)
        with tempfile.TemporaryDirectory() as folder:
            paths = _written((pairs[False], pairs[True]), slope, crs, Path(folder))
            objects = _objects(paths)
        outcomes = [_outcome(thing, count, objects) for thing, count in zip(things, returns, strict=True)]
        wrong = _false(things, objects)
        say(f"{name}, seed {seed}: {wrong} false, {(objects['kind'] == UNKNOWN).sum()} unknown; {_said(outcomes)}")
        yield wrong, outcomes


def _objects(paths: Paths) -> gpd.GeoDataFrame:
    dates = f"2024-05-01={paths.first}", f"2024-06-01={paths.second}"
    arguments = ["--epoch", dates[0], "--epoch", dates[1], "--roi", str(paths.roi), "--output-dir", str(paths.results)]
    code, said = exit_of(["inspect", *arguments])
    if code:
        raise RuntimeError(said)
    return gpd.read_file(paths.results / "objects.gpkg", layer="objects")


def _outcome(thing: Thing, returns: int, objects: gpd.GeoDataFrame) -> Outcome:
    same = objects[((objects["change"] == APPEARED) == thing.appeared) & (objects["kind"] != VEGETATION)]
    near = same[same.geometry.distance(shapely.Point(thing.middle[:2])) < 0.6 * thing.reach]
    if near.empty:
        return Outcome(thing, returns, False, "", 0.0)
    largest = near.loc[near["volume_m3"].idxmax()]
    return Outcome(thing, returns, True, str(largest["kind"]), float(near["volume_m3"].sum()) / thing.volume)


def _false(things: Sequence[Thing], objects: gpd.GeoDataFrame) -> int:
    named = objects[~objects["kind"].isin([VEGETATION, UNKNOWN])]
    near = shapely.union_all([shapely.Point(thing.middle[:2]).buffer(thing.reach) for thing in things])
    return int((~named.geometry.intersects(near)).sum())


def _said(outcomes: Sequence[Outcome]) -> str:
    return "; ".join(
        f"{o.thing.shape.kind} {o.thing.shape.length:g} m {'new' if o.thing.appeared else 'gone'} "
        f"({o.returns} returns) " + (f"{o.kind}, volume x {o.volume:.2f}" if o.found else "not found")
        for o in outcomes
    )


if __name__ == "__main__":
    for _ in _runs(sys.argv[1], [int(seed) for seed in sys.argv[2:]] or (0, *SEEDS)):
        pass
