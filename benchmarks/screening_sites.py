"""Screening where it counts: hazards put into real and simulated ground, found at one false zone per 1,000 m².

``python -m slopewatch.benchmarks screening_sites`` prints the table; ``python -m slopewatch.benchmarks.screening_sites
--network`` adds the shipped network, ``--relief FILES`` the raster network by weights that left surveys out,
``--results FOLDER`` keeps every trial as JSON. The threshold of each detector is the level at which untouched ground of
the other surveys of the same kind (clouds, elevation models, simulated slopes) shows one false zone per 1,000 m².
Ground on which not even a hazard of 1 m can be found (``SEEN_M``), where screening is to refuse, has its results in the
table but no part in thresholds. A zone is a group of connected cells of 0.5 m above the threshold, at least 1 m² large;
a hazard is found if a zone of its sign covers a quarter of it or 1 m² of it. For diagnosis the same is measured with
the threshold of the untouched ground of the place itself. Among the hazards are places where nothing is put in: what is
found there is found by chance, or because a detector takes true hazards for a sign of others.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from ..engine.core.arrays import Float
from ..models.preparation import even_scores, relative_scores
from ..models.preparation.bump_filter import cell_heights
from ..models.preparation.raster_zones import (
    PER_M2,
    Scores,
    common_levels,
    conformal_level,
    level_for_rate,
    zone_counts,
)
from ..models.preparation.relief_channels import relief_channels
from ..models.preparation.relief_raster import ReliefRaster
from .screening_ground import ELEVATION, POINTS, SIMULATED, Place, real_places, simulated_places
from .screening_trials import (
    DIAMETERS_M,
    HEIGHTS_M,
    NOTHING_M,
    Detector,
    PlaceResult,
    Trial,
    filter_scores,
    network_scores,
    try_place,
)
from .table import Row, heading, markdown

COUNT = 12
"""Hazards of each height and diameter at a place; large surveys have several places."""
NEEDED_EDGES = (0.5, 1.0, 1.5, 2.5, math.inf)
"""Bounds of the bins of a hazard's height over the height that its place needs."""
RELIEF = "U-Net on relief"
EVEN = "filter, even t"
SEEN_M = 1.0
"""A70 of the most easily found width beyond which a place sets no threshold."""
MIN_DENSITY = 3.0
"""Ground points/m² from which the aims for real ground hold."""
AIMS = {(1.5, 2.5): 0.60, (2.5, math.inf): 0.80}
REFERENCE = "filter, t"
_KINDS = {POINTS: "real clouds", ELEVATION: "elevation models", SIMULATED: "simulated slopes"}


@dataclass(frozen=True)
class Judged:
    """A trial and whether each detector found it, at the threshold of ``others`` and at that of its ``own`` place."""

    trial: Trial
    place: Place
    others: dict[str, bool]
    own: dict[str, bool]


@dataclass(frozen=True)
class SiteFigures:
    """Thresholds of a detector at a place, and the false zones per 1,000 m² of its untouched ground there."""

    others: float
    own: float
    false_others: float
    false_own: float


@dataclass(frozen=True)
class Outcome:
    """All trials judged, and the figures of each detector at each place: ``sites[place][detector]``."""

    judged: list[Judged]
    sites: dict[str, dict[str, SiteFigures]]
    results: list[PlaceResult]


def run_places(places: Sequence[Place], detectors: Sequence[Detector], count: int = COUNT) -> list[PlaceResult]:
    """Try all places; progress goes to standard error."""
    results = []
    for place in places:
        started = time.process_time()
        results.append(try_place(place, detectors, count))
        taken = time.process_time() - started
        print(f"{place.name}: {len(results[-1].trials)} hazards, {taken:.1f} s", file=sys.stderr, flush=True)
    return results


def judge(results: Sequence[PlaceResult]) -> Outcome:
    """Set the thresholds and say what was found with them."""
    names = list(results[0].scores)
    sites: dict[str, dict[str, SiteFigures]] = {result.place.name: {} for result in results}
    for name in names:
        for kind in _KINDS:
            same = [result for result in results if result.place.kind == kind]
            for result, figures in zip(same, _thresholds(same, name), strict=True):
                sites[result.place.name][name] = figures
    judged = [
        Judged(
            trial,
            result.place,
            {name: trial.strength[name] > sites[result.place.name][name].others for name in names},
            {name: trial.strength[name] > sites[result.place.name][name].own for name in names},
        )
        for result in results
        for trial in result.trials
    ]
    return Outcome(judged, sites, list(results))


def _thresholds(results: Sequence[PlaceResult], name: str) -> list[SiteFigures]:
    """Figures of one detector at each of the places, which are of one kind."""
    if not results:
        return []
    levels = common_levels([result.scores[name] for result in results])
    counts = np.array([zone_counts(result.scores[name], levels) for result in results])
    area = np.array([max(result.scores[name].area, 1e-9) for result in results])
    groups = np.array([result.place.group for result in results])
    seen = np.array([result.needed <= SEEN_M for result in results])
    figures = []
    for k, result in enumerate(results):
        others = seen & (groups != groups[k])
        rates = PER_M2 * counts[k] / area[k]
        own = level_for_rate(levels, rates, float(area[k]))
        foreign = own
        if others.any():
            together = PER_M2 * counts[others].sum(axis=0) / area[others].sum()
            foreign = level_for_rate(levels, together, float(area[others].sum()))
        at = PER_M2 * zone_counts(result.scores[name], np.array([foreign, own])) / area[k]
        figures.append(SiteFigures(foreign, own, float(at[0]), float(at[1])))
    return figures


def budget_levels(
    results: Sequence[PlaceResult], name: str = EVEN, in_use: Mapping[float, float] = even_scores.LEVELS
) -> list[Row]:
    """The level of a detector for each number of accepted false zones, next to the one ``in_use``, by conformal risk
    control on all clouds and simulated slopes on which something can be seen; and what is then false on a survey that
    took no part.
    """
    used = [one for one in results if one.place.kind != ELEVATION and one.needed <= SEEN_M]
    tail = common_levels([one.scores[name] for one in used])
    levels = np.linspace(float(tail[0]), float(tail[-1]), 400)
    rates = np.array([PER_M2 * zone_counts(one.scores[name], levels) / one.area for one in used])
    area = np.array([one.area for one in used])
    groups = np.array([one.place.group for one in used])
    rows = []
    for wanted, used_level in in_use.items():
        cap = max(3.0, 2.0 * wanted)
        level = conformal_level(levels, rates, wanted, cap)
        false = {}
        for group in dict.fromkeys(groups):
            mine = groups == group
            others = conformal_level(levels, rates[~mine], wanted, cap)
            if math.isfinite(others):
                at = np.array([np.interp(others, levels, one) for one in rates[mine]])
                false[group] = float((at * area[mine]).sum() / area[mine].sum())
        measured = f"{level:.2f}" if math.isfinite(level) else f"none of {len(used)} places"
        shown = ", ".join(f"{group} {value:.1f}" for group, value in false.items())
        rows.append(
            Row(
                f"level of {name} for {wanted:g} false zones per 1,000 m²",
                measured,
                f"{used_level:g} in use",
                shown,
            )
        )
    return rows


def share(found: Iterable[bool]) -> tuple[float, float, float, int]:
    """Share, bounds of its 95 % interval (Wilson 1927, doi:10.1080/01621459.1927.10502953), and number."""
    found = list(found)
    if not found:
        return math.nan, math.nan, math.nan, 0
    interval = binomtest(sum(found), len(found)).proportion_ci(0.95, method="wilson")
    return sum(found) / len(found), float(interval.low), float(interval.high), len(found)


def table(outcome: Outcome) -> list[Row]:
    """Rows by kind of ground: by height, by diameter, by height over A70, and by survey."""
    names = list(outcome.results[0].scores)
    rows: list[Row] = []
    for kind, title in _KINDS.items():
        mine = [one for one in outcome.judged if one.place.kind == kind]
        if not mine:
            continue
        nothing = [one for one in mine if abs(one.trial.height) <= NOTHING_M]
        if nothing:
            rows.append(_row(f"{title}: places with nothing put in found", nothing, names))
        mine = [one for one in mine if abs(one.trial.height) > NOTHING_M]
        for height in HEIGHTS_M:
            chosen = [one for one in mine if abs(abs(one.trial.height) - height) < 1e-9]
            rows.append(_row(f"{title}: hazards of {height:g} m found", chosen, names))
        for diameter in DIAMETERS_M:
            chosen = [one for one in mine if abs(one.trial.diameter - diameter) < 1e-6]
            if chosen:
                rows.append(_row(f"{title}: hazards of {diameter:g} m width found", chosen, names))
        dense = mine if kind != POINTS else [one for one in mine if one.place.density >= MIN_DENSITY]
        for low, high in itertools.pairwise(NEEDED_EDGES):
            chosen = [one for one in dense if low <= abs(one.trial.height) / one.trial.needed < high]
            bounds = f"{low:g} to {high:g}" if math.isfinite(high) else f"above {low:g}"
            aim = AIMS.get((low, high)) if kind == POINTS else None
            limit = f" (at least {MIN_DENSITY:g} points/m²)" if kind == POINTS else ""
            rows.append(_row(f"{title}{limit}: hazards {bounds} x A70 found", chosen, names, aim))
        for group in dict.fromkeys(one.place.group for one in mine):
            rows.append(_group_row(group, [one for one in mine if one.place.group == group], outcome, names))
    return rows


def _row(title: str, chosen: Sequence[Judged], names: Sequence[str], aim: float | None = None) -> Row:
    texts = {name: _text(share(one.others[name] for one in chosen)) for name in names}
    main = names[-1]
    met = None if aim is None or not chosen else share(one.others[main] for one in chosen)[0] >= aim
    rest = "; ".join(f"{name} {text}" for name, text in texts.items() if name != main)
    own = _text(share(one.own[main] for one in chosen))
    target = "" if aim is None else f">= {100 * aim:.0f} %"
    return Row(f"{title}, of {len(chosen)}", f"{texts[main]} ({main})", target, f"own threshold {own}; {rest}", met)


def _group_row(group: str, chosen: Sequence[Judged], outcome: Outcome, names: Sequence[str]) -> Row:
    """Recall of 0.3, 0.5 and 0.8 m and false zones of a survey."""
    results = [result for result in outcome.results if result.place.group == group]
    area = sum(result.area for result in results)
    texts = {}
    for name in names:
        parts = []
        for height in (0.3, 0.5, 0.8):
            same = [one.others[name] for one in chosen if abs(abs(one.trial.height) - height) < 1e-9]
            parts.append(f"{100 * np.mean(same):.0f}" if same else "-")
        false = sum(outcome.sites[r.place.name][name].false_others * r.area for r in results) / area
        texts[name] = f"{', '.join(parts)} % at {false:.1f}"
    by_diameter = [[one.trial.needed for one in chosen if abs(one.trial.diameter - d) < 1e-6] for d in DIAMETERS_M]
    needed = [float(np.median(values)) if values else math.nan for values in by_diameter]
    a70 = ", ".join("-" if math.isnan(value) else f"{value:.2f}" for value in needed)
    density = float(np.median([result.place.density for result in results]))
    main = names[-1]
    rest = "; ".join(f"{name} {text}" for name, text in texts.items() if name != main)
    return Row(
        f"{group}, {area:,.0f} m², {density:.0f} points/m²: 0.3, 0.5, 0.8 m found; false zones per 1,000 m²",
        f"{texts[main]} ({main})",
        "",
        f"A70 of 2, 3, 5, 8 m: {a70} m; {rest}",
    )


def _text(figures: tuple[float, float, float, int]) -> str:
    value, low, high, count = figures
    return "-" if not count else f"{100 * value:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def as_json(outcome: Outcome) -> dict[str, object]:
    """All trials and thresholds, for pictures and other thresholds."""
    return {
        "places": [
            {
                "name": result.place.name,
                "group": result.place.group,
                "kind": result.place.kind,
                "points": len(result.place.flat),
                "density": result.place.density,
                "area_m2": result.area,
                "a70_of_easiest_width_m": result.needed,
                "detectors": {name: vars(figures) for name, figures in outcome.sites[result.place.name].items()},
            }
            for result in outcome.results
        ],
        "hazards": [
            {
                "place": one.place.name,
                "height_m": one.trial.height,
                "diameter_m": one.trial.diameter,
                "where_m": one.trial.where,
                "a70_m": one.trial.needed,
                "strength": {k: (v if math.isfinite(v) else None) for k, v in one.trial.strength.items()},
                "found": one.others,
                "found_at_own_threshold": one.own,
            }
            for one in outcome.judged
        ],
    }


def shipped_network() -> Detector:
    """The shipped weights, by the package's own prediction."""
    from ..models.inference.prediction import predict
    from ..models.network.shipped import shipped_model
    from ..models.network.weights import load_model

    network = load_model(*shipped_model()).network

    def probabilities(xyz: Float) -> Float:
        return np.asarray(predict(network, xyz).probabilities, dtype=np.float64)

    return network_scores(probabilities)


def relief_network(weights: Sequence[Path]) -> tuple[Detector, set[str]]:
    """The raster network, at each place with weights that were trained without its survey, and these surveys.

    Raises:
        InputError: weights cannot be read.
    """
    from ..models.network.unet import load_unet, log_odds, raster_logits

    networks = []
    unseen: dict[str, list[int]] = {}
    for number, path in enumerate(weights):
        network, description = load_unet(path)
        networks.append(network)
        for survey in description["training"]["left_out"]:
            unseen.setdefault(survey, []).append(number)

    def scores(place: Place, raster: ReliefRaster) -> dict[str, Scores]:
        relief = relief_channels(cell_heights(place.flat, raster.cell, raster.origin, raster.shape))
        chosen = unseen.get(place.group, range(len(networks)))
        logits = np.mean([raster_logits(networks[k], relief.channels) for k in chosen], axis=0)
        up, down = (np.where(raster.covered, odds, np.nan) for odds in log_odds(logits))
        return {RELIEF: relative_scores.relative_scores(up, down, raster.cell)}

    return scores, set(unseen)


def rows(
    keep: Path | None = None,
    *,
    network: bool = False,
    relief: Sequence[Path] = (),
    count: int = COUNT,
    extract: bool = True,
) -> list[Row]:
    """The table; ``keep`` with the suffix .json is written with every trial. With weights ``relief`` of the raster
    network real ground is judged only where one of them was trained without it.
    """
    detectors = [filter_scores, *([shipped_network()] if network else [])]
    places = [*real_places(extract=extract), *simulated_places()]
    if relief:
        detector, unseen = relief_network(relief)
        detectors.append(detector)
        places = [place for place in places if place.kind == SIMULATED or place.group in unseen]
    outcome = judge(run_places(places, detectors, count))
    if keep is not None:
        keep.parent.mkdir(parents=True, exist_ok=True)
        keep.with_suffix(".json").write_text(json.dumps(as_json(outcome)), encoding="utf-8")
    levels = budget_levels(outcome.results)
    if relief:
        levels += budget_levels(outcome.results, RELIEF, relative_scores.LEVELS)
    return [*table(outcome), *levels]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--network", action="store_true", help="the shipped weights, too")
    parser.add_argument("--relief", type=Path, nargs="*", default=(), help="weights of the raster network")
    parser.add_argument("--count", type=int, default=COUNT, help="hazards of each height and width at a place")
    parser.add_argument("--no-extraction", action="store_true", help="leave out clouds without classified ground")
    parser.add_argument("--results", type=Path, help="folder for screening_sites.json")
    options = parser.parse_args(arguments)
    keep = options.results / "screening_sites.json" if options.results else None
    print(heading())
    found = rows(
        keep, network=options.network, relief=options.relief, count=options.count, extract=not options.no_extraction
    )
    print(markdown("Screening of hazards put into real ground", found))
    return int(any(row.met is False for row in found))


if __name__ == "__main__":
    sys.exit(main())
