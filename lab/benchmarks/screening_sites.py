"""Screening where it counts: hazards put into real and simulated ground, found at one false zone per 1,000 m².

``python -m slopewatch.lab.benchmarks.screening_sites --relief FILES`` prints the tables with the raster network by
weights that left surveys out (``training.left_out`` of their JSON; several seeds are runs of their own),
``--network`` adds the shipped network and both combined, ``--points FILES`` further weights of the network on points
(such as those of a fold of the published pipeline) by their odds, ``--ground FILES`` surveys of one's own.
``--results FOLDER`` keeps scores, so that a run that was stopped goes on, and the tables as Markdown and JSON.
``python -m slopewatch.lab screening_sites`` prints the main rows without networks.

The level of each detector is that at which untouched ground of the other surveys shows one false zone per 1,000 m²:
one level for real clouds and simulated slopes, one for elevation models. Ground on which not even a hazard of 1 m can
be found, where screening is to refuse, has its results in the table but no part in levels. A zone is a group of
connected cells of 0.5 m above the level, at least 1 m² large; a hazard is found if a zone of its sign covers a
quarter of it or 1 m² of it.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ...engine.core.arrays import Float32
from ...engine.core.errors import InputError
from ...models.preparation import point_scores
from ...models.preparation.raster_zones import Scores
from ...models.preparation.relative_scores import relative_scores
from .screening_budget import budget_levels
from .screening_calibration import KindCalibration, Platt, calibrate, counted
from .screening_cases import cases, share
from .screening_combined import COMBINED, LARGER, WEIGHTS, added, chosen_ways, combined, larger
from .screening_ground import POINTS, own_places, real_places, simulated_places
from .screening_levels import Measured, SiteFigures, measure
from .screening_networks import (
    POINT_ZONES,
    RAW,
    RELATIVE,
    SHIPPED,
    Weights,
    further_networks,
    load_weights,
    relative,
    runs_of,
    shipped_network,
)
from .screening_store import kept_place
from .screening_table import AIMS, KINDS, MIN_DENSITY, Judged, Section, per_area, sections, text
from .screening_trials import DIAMETERS_M, FILTERS, HEIGHTS_M, Detector, PlaceResult
from .table import Row, heading

COUNT = 12
"""Hazards of each height and diameter at a place; large surveys have several places."""
Answers = Callable[[int], Float32]
"""Scores of one run of a detector at the place with a number."""


@dataclass(frozen=True)
class Options:
    """What takes part: weights of the raster network, the shipped network and further ``points`` networks, hazards of
    each height and width,
    ``extract`` for clouds without a class for ground, files of ``ground`` of one's own, and of all surveys only those
    named. ``results`` is the folder that keeps what was made.
    """

    relief: Sequence[Path] = ()
    network: bool = False
    points: Sequence[Path] = ()
    count: int = COUNT
    extract: bool = True
    ground: Sequence[Path] = ()
    surveys: Sequence[str] = ()
    results: Path | None = None


def run(options: Options) -> Judged:
    """Try all places and judge all detectors.

    Raises:
        InputError: weights or ground cannot be used, or no place is left.
    """
    weights = load_weights(options.relief)
    keep = options.results / "places" if options.results else None
    started = time.perf_counter()
    places = [*real_places(extract=options.extract, keep=keep), *simulated_places(), *own_places(options.ground)]
    _say(f"{len(places)} places read", started)
    if options.surveys:
        places = [one for one in places if one.group in options.surveys or one.name in options.surveys]
    runs = {one.name: runs_of(one, weights) for one in places}
    if weights:
        left = [one.group for one in places if not runs[one.name]]
        _say(f"left out, as weights may have seen them: {', '.join(dict.fromkeys(left)) or 'none'}")
        places = [one for one in places if runs[one.name]]
    if not places:
        raise InputError("No survey is left to screen; give weights that left some out, or other --surveys.")
    shipped = dict([shipped_network()]) if options.network else {}
    further = further_networks(options.points)
    shipped_and_further = {**shipped, **dict(further.values())}
    results = [kept_place(keep, one, _detectors(runs[one.name], shipped_and_further), options.count) for one in places]
    names = {column: name for column, (name, _) in further.items()}
    return judge(results, runs, next(iter(shipped), None), keep, names)


def _detectors(runs: Sequence[Weights], shipped: Mapping[str, Detector]) -> dict[str, Detector]:
    return {**{one.name: one.detector() for one in runs}, **shipped}


def judge(
    results: Sequence[PlaceResult],
    runs: Mapping[str, Sequence[Weights]],
    shipped: str | None = None,
    keep: Path | None = None,
    further: Mapping[str, str] | None = None,
) -> Judged:
    """Levels, what is found and false with them, and calibration, of all detectors.

    Args:
        runs: weights of the raster network by place, one for each seed; none anywhere or everywhere as many.
        shipped: name of the shipped network among the answers.
        keep: folder in which what was measured is kept.
        further: names among the answers of further networks on points, by column.
    """
    measured: dict[str, list[Measured]] = {}

    def add(column: str, number: int, answers: Answers, outline: float = np.inf) -> Measured:
        key = f"{column} {number} {_names(results, runs, number)} {(further or {}).get(column, shipped)}"
        one = _measured(results, answers, key, keep, outline)
        measured.setdefault(column, []).append(one)
        return one

    for column, name in FILTERS.items():
        if all(name in one.answers for one in results):
            add(column, 0, lambda k, name=name: results[k].answers[name])  # type: ignore[misc]
    for column, name in (further or {}).items():
        add(column, 0, lambda k, name=name: results[k].answers[name])  # type: ignore[misc]
    if shipped is not None:
        add(SHIPPED, 0, lambda k: results[k].answers[shipped])
        points = add("RandLA-Net, relative", 0, lambda k: _relative(results[k], shipped))
        add(POINT_ZONES, 0, lambda k: _relative(results[k], shipped, point_scores.odds_scores), point_scores.OUTLINE)
    seeds = len(next(iter(runs.values()), []))
    ways: dict[str, list[Measured]] = {}
    for number in range(seeds):

        def raw(k: int, number: int = number) -> Float32:
            return results[k].answers[runs[results[k].place.name][number].name]

        def over(k: int, number: int = number) -> Float32:
            return _relative(results[k], runs[results[k].place.name][number].name)

        add(RAW, number, raw)
        ours = add(RELATIVE, number, over)
        if shipped is not None:
            for way, answers in _joined(results, over, shipped, ours, points).items():
                ways.setdefault(way, []).append(add(way, number, answers))
    chosen: dict[str, str] = {}
    for way in ways:
        measured[f"+ {way}"] = measured.pop(way)
    if ways:
        measured[COMBINED] = combined(results, ways)
        by_survey, best = chosen_ways(results, ways)
        chosen = {**by_survey, "": best}
    return Judged(results, measured, cases(results, measured), _calibrated(results, runs), chosen)


def _joined(
    results: Sequence[PlaceResult], ours: Answers, shipped: str, first: Measured, second: Measured
) -> dict[str, Answers]:
    """The ways of joining one run of the raster network with the shipped network."""

    def larger_of(k: int) -> Float32:
        name = results[k].place.name
        levels = first.figures[name].others, second.figures[name].others
        return larger(ours(k), _relative(results[k], shipped), levels)

    def sum_of(k: int, weight: float) -> Float32:
        return added(ours(k), _relative(results[k], shipped), weight)

    sums: dict[str, Answers] = {
        f"{weight:g} x RandLA-Net": functools.partial(sum_of, weight=weight) for weight in WEIGHTS
    }
    return {**sums, LARGER: larger_of}


def _relative(result: PlaceResult, name: str, scores: Callable[..., Scores] = relative_scores) -> Float32:
    return relative(result.answers[name], result.lattice.cell, scores)


def _names(results: Sequence[PlaceResult], runs: Mapping[str, Sequence[Weights]], number: int) -> list[str]:
    mine = [runs.get(one.place.name, []) for one in results]
    return [one[number].name for one in mine if len(one) > number]


def _measured(
    results: Sequence[PlaceResult], answers: Answers, key: str, keep: Path | None, outline: float
) -> Measured:
    """One run measured, or read where it was measured before."""
    how = [key] if np.isinf(outline) else [key, f"outline {outline:g}"]
    made = hashlib.sha256("\n".join([*how, *(one.key for one in results)]).encode()).hexdigest()[:16]
    path = keep / f"measured-{made}.json" if keep else None
    if path is not None and path.is_file():
        kept = json.loads(path.read_text(encoding="utf-8"))
        figures = {name: SiteFigures(**one) for name, one in kept["figures"].items()}
        return Measured(figures, {name: np.array(one) for name, one in kept["strength"].items()})
    started = time.perf_counter()
    one = measure(results, [answers(k) for k in range(len(results))], outline)
    _say(f"measured {key.split(' [')[0]}", started)
    if path is not None:
        listed = {"figures": {name: asdict(figures) for name, figures in one.figures.items()}}
        strength = {name: values.tolist() for name, values in one.strength.items()}
        path.write_text(json.dumps({**listed, "strength": strength}), encoding="utf-8")
    return one


def _calibrated(
    results: Sequence[PlaceResult], runs: Mapping[str, Sequence[Weights]]
) -> dict[str, tuple[list[KindCalibration], Platt]]:
    """Of the raster network's log odds and of its relative ones, all seeds together."""
    if not any(runs.values()):
        return {}
    found = {}
    for title, is_raw in ((RAW, True), (RELATIVE, False)):
        counts = []
        for one in results:
            names = list(dict.fromkeys(weights.name for weights in runs[one.place.name]))
            answers = [one.answers[name] if is_raw else _relative(one, name) for name in names]
            counts.append(np.sum([counted(one, scores, odds=is_raw) for scores in answers], axis=0))
        found[title] = calibrate(results, counts)
    return found


def as_json(judged: Judged, made: Sequence[Section]) -> dict[str, object]:
    """All hazards, levels and figures and the tables ``made`` of them, for pictures and other tables."""
    names = list(judged.measured)
    return {
        "tables": [vars(one) for one in made],
        "calibration": {
            name: {"kinds": [asdict(one) for one in kinds], "scale": fit.scale, "shift": fit.shift}
            for name, (kinds, fit) in judged.calibration.items()
        },
        "places": [
            {
                "name": one.place.name,
                "group": one.place.group,
                "kind": one.place.kind,
                "points": len(one.place.flat),
                "density": one.place.density,
                "area_m2": one.area,
                "a70_of_easiest_width_m": one.needed,
                "detectors": {
                    name: [asdict(run.figures[one.place.name]) for run in judged.measured[name]] for name in names
                },
                "hazards": [
                    {
                        "height_m": trial.height,
                        "diameter_m": trial.diameter,
                        "where_m": trial.where,
                        "a70_m": trial.needed,
                        "strength": {
                            name: [_finite(run.strength[one.place.name][number]) for run in judged.measured[name]]
                            for name in names
                        },
                    }
                    for number, trial in enumerate(one.trials)
                ],
            }
            for one in judged.results
        ],
    }


def _finite(value: float) -> float | None:
    return round(float(value), 5) if math.isfinite(value) else None


def main_rows(judged: Judged) -> list[Row]:
    """What is found by height on each kind of ground, the aims by A70, and the levels of a budget."""
    told, main = judged.told, list(judged.measured)[-1]
    found = []

    def row(title: str, chosen: np.ndarray, aim: float | None = None) -> None:
        shares = {name: share(by_level["others"][:, chosen]) for name, by_level in told.found.items()}
        rest = "; ".join(f"{name} {one}" for name, one in shares.items() if name != main)
        met = None if aim is None or not chosen.any() else shares[main].value >= aim
        target = "" if aim is None else f">= {100 * aim:.0f} %"
        found.append(Row(f"{title}, of {chosen.sum()}", f"{shares[main]} ({main})", target, rest, met))

    for kind, title in KINDS.items():
        mine = told.kind == kind
        if mine.any():
            row(f"{title}: places with nothing put in found", mine & (told.height == 0))
            for height in HEIGHTS_M:
                row(f"{title}: hazards of {height:g} m found", mine & (np.abs(told.height - height) < 1e-9))
            for diameter in DIAMETERS_M:
                wide = mine & (told.height > 0) & (np.abs(told.diameter - diameter) < 1e-6)
                if wide.any():
                    row(f"{title}: hazards of {diameter:g} m width found", wide)
    dense = (told.kind == POINTS) & (told.density >= MIN_DENSITY)
    for bound, aim in AIMS.items():
        row(
            f"real clouds (at least {MIN_DENSITY:g} points/m²): above {bound:g} x A70",
            dense & (told.ratio > bound),
            aim,
        )
    for group in dict.fromkeys(one.place.group for one in judged.results):
        mine = [one for one in judged.results if one.place.group == group]
        false = {
            name: float(np.mean([per_area(one, mine, "false_others", "area") for one in runs]))
            for name, runs in judged.measured.items()
        }
        rest = "; ".join(f"{name} {value:.1f}" for name, value in false.items() if name != main)
        found.append(Row(f"{group}: false zones per 1,000 m²", f"{false[main]:.1f} ({main})", "", rest))
    return [*found, *budget_levels(judged.results)]


def rows(keep: Path | None = None, options: Options | None = None) -> list[Row]:
    """The main rows; tables and all hazards are written beside ``keep``."""
    judged = run(options or Options())
    if keep is not None:
        write(judged, sections(judged), keep.parent)
    return main_rows(judged)


def write(judged: Judged, made: Sequence[Section], folder: Path) -> None:
    """``screening_sites.md`` and ``screening_sites.json`` in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "screening_sites.md").write_text(text(made, heading), encoding="utf-8")
    (folder / "screening_sites.json").write_text(json.dumps(as_json(judged, made)), encoding="utf-8")


def _say(message: str, started: float | None = None) -> None:
    taken = "" if started is None else f": {time.perf_counter() - started:.1f} s"
    print(f"{message}{taken}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 if an aim is missed by the last detector."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--network", action="store_true", help="the shipped weights, too")
    parser.add_argument("--relief", type=Path, nargs="*", default=(), help="weights of the raster network")
    parser.add_argument("--points", type=Path, nargs="*", default=(), help="further weights of the network on points")
    parser.add_argument("--ground", type=Path, nargs="*", default=(), help="clouds or elevation models of one's own")
    parser.add_argument("--surveys", nargs="*", default=(), help="only these surveys or places")
    parser.add_argument("--count", type=int, default=COUNT, help="hazards of each height and width at a place")
    parser.add_argument("--no-extraction", action="store_true", help="leave out clouds without classified ground")
    parser.add_argument("--results", type=Path, help="folder for scores, screening_sites.md and screening_sites.json")
    given = parser.parse_args(arguments)
    options = Options(
        given.relief,
        given.network,
        given.points,
        given.count,
        not given.no_extraction,
        given.ground,
        given.surveys,
        given.results,
    )
    try:
        judged = run(options)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    made, summary = sections(judged), main_rows(judged)
    print(text(made, heading))
    for row in summary:
        if row.figure.startswith("level of"):
            print(f"- {row.figure}: {row.value} ({row.target}); on surveys left out {row.peer}")
    if options.results:
        write(judged, made, options.results)
    return int(any(row.met is False for row in summary))


if __name__ == "__main__":
    sys.exit(main())
