"""What the whole chain detects: simulated pairs with and without change, under no to dense vegetation.

Each pair goes through ground extraction, registration, differencing and zones at the default settings, with cells that
grow, and also with cells of one size. Half of the pairs hold bulges and hollows of 2 to 30 cm over 0.5 to 20 m²;
the others differ by noise, vegetation and a rigid offset alone. Those with changes are looked at a second time, with
closed grass on half of the slope.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from geopandas import GeoDataFrame

from ...engine.change.result import Change
from ...engine.zones.extraction import Zones
from ...interface.parameters import ChangeParameters, SurveyParameters
from ...simulation.surveys.change import Bump, true_change_raster
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from .chain import changed, registered
from .detection_results import Detected, FalseZone, PairResult, Volume, write_results
from .table import Row, ratio_class, say

PAIRS = 60
VEGETATION = (0.0, 0.2, 0.4, 0.6, 0.8)
POINTS = 80_000
"""Of an epoch: about 100 returns a m² of the slope."""
LENGTH, HEIGHT, ANGLE = 30.0, 12.0, 39.0
AMPLITUDE, AREA = (0.02, 0.30), (0.5, 20.0)
RATIOS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, math.inf)
"""Limits of the classes of amplitude over level of detection."""
HIGH = 0.10
CELLS = {"fixed": ChangeParameters(adaptive=False), "growing": ChangeParameters(adaptive=True)}
"""Growing ones are the default."""
GRASS = 0.5
MIN_FOUND_IN_GRASS, MIN_FOUND_UNDER_PLANTS = 27 / 35, 5 / 7
"""Shares to be found: of changes of three times the level with grass on half of the slope, and of those of 10 cm and
more under much vegetation."""
MUCH_VEGETATION = (0.6, 0.8)
MAX_STILL_M = 0.005
"""A zone is false if nowhere in it the ground has moved by more than this, m."""


def drawn_changes(rng: np.random.Generator, run: float) -> tuple[Bump, ...]:
    """Up to three bulges and hollows apart from each other on a slope of ``run`` m along the map."""
    placed: list[Bump] = []
    for _ in range(60):
        amplitude = math.exp(rng.uniform(*np.log(AMPLITUDE))) * rng.choice((-1.0, 1.0))
        area, aspect = math.exp(rng.uniform(*np.log(AREA))), rng.uniform(0.6, 1.6)
        half_u, half_v = math.sqrt(area * aspect / math.pi), math.sqrt(area / aspect / math.pi)
        if half_v > run / 2 - 1.0:
            continue
        u, v = rng.uniform(half_u + 1, LENGTH - half_u - 1), rng.uniform(half_v + 0.8, run - half_v - 0.8)
        apart = all(
            abs(u - other.u) > half_u + other.half_u + 1 or abs(v - other.v) > half_v + other.half_v + 1
            for other in placed
        )
        if apart:
            placed.append(Bump(float(u), float(v), half_u, half_v, float(amplitude)))
        if len(placed) == 3:
            break
    return tuple(placed)


def simulated(number: int, grass: float = 0.0) -> SimulatedPair:
    """Pair ``number``: even ones hold changes, odd ones none; the vegetation goes round in both.

    Args:
        grass: share of the slope under closed grass, from its left end on.
    """
    run = HEIGHT / math.tan(math.radians(ANGLE))
    parameters = SurveyParameters(
        seed=500 + number,
        points=POINTS,
        length=LENGTH,
        height=HEIGHT,
        angle=ANGLE,
        vegetation=VEGETATION[number // 2 % len(VEGETATION)],
        grass=grass,
        layout="left",
    )
    changes = () if number % 2 else drawn_changes(np.random.default_rng([parameters.seed, 7]), run)
    return simulate_pair(parameters, changes=changes)


def compared(pair: SimulatedPair, change: Change, zones: Zones) -> PairResult:
    """The zones of a pair against its truth."""
    truth = pair.true_change_raster(change.grid, 8)
    signs = np.sign(np.concatenate([[0.0], zones.frame["vol_net_m3"].to_numpy(dtype=np.float64)]))[zones.labels]
    found, shown = [], []
    for known in pair.changes:
        assert isinstance(known, Bump)
        raster = true_change_raster((known,), pair.scene.frame, change.grid, 8)
        shown.append(set(np.unique(zones.labels[np.abs(raster) > MAX_STILL_M]).tolist()) - {0})
        alone = np.abs(raster) > 0.5 * abs(known.height)
        core = alone & change.valid
        if not core.any():
            core = alone
        level = float(np.nanmedian(change.level[core])) if change.valid[core].any() else math.inf
        share = float(np.mean(signs[core] == np.sign(known.height)))
        area = math.pi * known.half_u * known.half_v
        found.append(Detected(known.height, area, level, share, pair.parameters.vegetation))
    moved = np.bincount(
        zones.labels.ravel(), weights=(np.abs(truth) > MAX_STILL_M).ravel(), minlength=len(zones.frame) + 1
    )
    unchanged = change.valid & (truth == 0)
    return PairResult(
        changes=tuple(found),
        volumes=tuple(_volumes(pair, zones, shown)),
        false_zones=tuple(_false_zones(zones.frame[moved[1:] == 0])),
        zones=len(zones.frame),
        beyond=float(np.mean(np.abs(change.dz[unchanged]) > change.level[unchanged])),
        vegetation=pair.parameters.vegetation,
    )


def _volumes(pair: SimulatedPair, zones: Zones, shown: list[set[int]]) -> Iterator[Volume]:
    """Of changes that one zone shows, which shows no other."""
    for number, (known, own) in enumerate(zip(pair.changes, shown, strict=True)):
        others = set().union(*shown[:number], *shown[number + 1 :])
        if len(own) == 1 and not own & others:
            row = zones.frame.iloc[own.pop() - 1]
            raised, lowered = known.volumes
            yield Volume(float(row["vol_low_m3"]), float(row["vol_high_m3"]), raised - lowered)


def _false_zones(frame: GeoDataFrame) -> Iterator[FalseZone]:
    for row in frame.itertuples():
        yield FalseZone(float(row.dz_p95_m), float(row.area_m2), float(row.lod95_m))


def results(count: int = PAIRS) -> dict[str, list[PairResult]]:
    """All pairs, one after the other, with each of ``CELLS``."""
    found: dict[str, list[PairResult]] = {name: [] for name in CELLS}
    for number in range(count):
        pair = simulated(number)
        registered_pair = registered(pair)
        for name, parameters in CELLS.items():
            found[name].append(compared(pair, *changed(*registered_pair, parameters)))
        say(f"pair {number + 1} of {count}")
    return found


def in_grass(count: int = PAIRS) -> list[PairResult]:
    """The pairs with changes among the first ``count``, with grass on half of the slope and cells that grow."""
    found = []
    for number in range(0, count, 2):
        pair = simulated(number, GRASS)
        found.append(compared(pair, *changed(*registered(pair), CELLS["growing"])))
        say(f"in grass, pair {number + 1} of {count}")
    return found


def rows(keep: Path | None = None) -> list[Row]:
    """Recall by amplitude in units of the level, volumes, false zones with and without change; ``keep`` is a CSV file
    for what became of each pair, from which ``lab/pictures/detection_picture.py`` draws.
    """
    found = results()
    if keep is not None:
        write_results(keep, found)
    fixed, growing = found["fixed"], found["growing"]
    lines = []
    for low, high in pairwise(RATIOS):
        of = partial(_between, low=low, high=high)
        figure = f"changes found, height {ratio_class(low, high)} times the level"
        lines.append(Row(figure, _found(growing, of), "", f"cells of one size {_found(fixed, of)}"))
    grassy = in_grass()
    lines.append(grass_row(growing, grassy))
    for cover in VEGETATION:
        lines.append(high_row(cover, growing, fixed, grassy))
    (own, zones), (other, more) = _covered(growing), _covered(fixed)
    lines.append(
        Row(
            f"volumes whose 95 % interval holds the true one ({zones} zones of one change each)",
            f"{100 * own:.0f} %",
            "90 to 99 %",
            f"cells of one size {100 * other:.0f} % of {more}",
            bool(0.9 <= own <= 0.99),
        )
    )
    false = _false(growing, changed_pairs=False)
    lines.append(
        Row(
            f"false zones on an unchanged slope ({len(growing) // 2} pairs)",
            f"{false:.2f}; {_false(growing, changed_pairs=True):.2f} on slopes with change",
            "below 0.1",
            f"cells of one size {_false(fixed, changed_pairs=False):.2f}; {_false(fixed, changed_pairs=True):.2f}",
            false < 0.1,
        )
    )
    own_share, other_share = (np.array([r.beyond for r in some if not r.changed]) for some in (growing, fixed))
    lines.append(
        Row(
            "unchanged cells beyond their level of 95 %, mean of the unchanged pairs",
            f"{100 * own_share.mean():.1f} % ({100 * own_share.min():.1f} to {100 * own_share.max():.1f})",
            "3 to 7 %",
            f"cells of one size {100 * other_share.mean():.1f} %",
            bool(0.03 <= own_share.mean() <= 0.07),
        )
    )
    return lines


def grass_row(open_ground: list[PairResult], grassy: list[PairResult]) -> Row:
    """Changes of three times the level and more, with grass on half of the slope and without."""
    found, count = _counts(grassy, lambda c: c.ratio >= 3)
    false = _false(grassy, changed_pairs=True)
    return Row(
        f"the same, 3 and more, with grass on half of the slope ({len(grassy)} pairs)",
        f"{found} of {count}; {false:.2f} false zones a slope",
        f"{100 * MIN_FOUND_IN_GRASS:.0f} %",
        f"without grass {_found(open_ground, lambda c: c.ratio >= 3)}",
        found >= MIN_FOUND_IN_GRASS * count if count else None,
    )


def high_row(cover: float, growing: list[PairResult], fixed: list[PairResult], grassy: list[PairResult]) -> Row:
    """Changes of 10 cm and more under a vegetation ``cover``; a target where that is much."""

    def high(change: Detected) -> bool:
        return change.vegetation == cover and abs(change.amplitude) >= HIGH

    found, count = _counts(growing, high)
    much = cover in MUCH_VEGETATION
    return Row(
        f"found under {100 * cover:.0f} % vegetation, height of 10 cm and more",
        _found(growing, high),
        "5 of 7" if much else "",
        f"cells of one size {_found(fixed, high)}; with grass on half of the slope {_found(grassy, high)}",
        found >= MIN_FOUND_UNDER_PLANTS * count if much and count else None,
    )


def _between(change: Detected, low: float, high: float) -> bool:
    return low <= change.ratio < high


def _found(results: list[PairResult], of: Callable[[Detected], bool]) -> str:
    found, count = _counts(results, of)
    return f"{found} of {count}"


def _counts(results: list[PairResult], of: Callable[[Detected], bool]) -> tuple[int, int]:
    """How many of the changes of a kind were found, and how many there are."""
    some = [c for result in results for c in result.changes if of(c)]
    return sum(c.found for c in some), len(some)


def _covered(results: list[PairResult]) -> tuple[float, int]:
    volumes = [v for result in results for v in result.volumes]
    return (float(np.mean([v.covered for v in volumes])) if volumes else float("nan")), len(volumes)


def _false(results: list[PairResult], *, changed_pairs: bool) -> float:
    """False zones a slope of the pairs with, or without, change."""
    some = [len(result.false_zones) for result in results if result.changed is changed_pairs]
    return float(np.mean(some)) if some else float("nan")
