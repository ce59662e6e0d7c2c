"""The tables of the benchmark of screening by sites: by height, width, survey, height over A70; false zones; the levels
from changed ground; factors of A70; calibration.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Bool
from ...models.preparation.raster_zones import PER_M2
from .screening_calibration import HAZARD_SHARE, KindCalibration, Platt
from .screening_cases import Cases, Share, a70_factor, share
from .screening_combined import COMBINED
from .screening_ground import ELEVATION, POINTS, SIMULATED
from .screening_levels import NEAR_M, Measured
from .screening_networks import FURTHER, POINT_ZONES, RAW, RELATIVE, SHIPPED
from .screening_trials import DIAMETERS_M, FILTERS, HEIGHTS_M, PlaceResult

KINDS = {POINTS: "real clouds", ELEVATION: "elevation models", SIMULATED: "simulated slopes"}
NEEDED_EDGES = (0.5, 1.0, 1.5, 2.5, math.inf)
"""Bounds of the bins of a hazard's height over the height that its place needs."""
MIN_DENSITY = 3.0
"""Ground points/m² from which the aims for real ground hold."""
AIMS = {1.5: 0.60, 2.5: 0.80}
"""Share to be found of the hazards above so many A70, on real clouds that are dense enough."""
SURVEY_HEIGHTS_M = (0.3, 0.5, 0.8)
MAX_FACTOR = 10.0
"""Of A70 that is told: a larger one says only that the detector hardly finds more where hazards are higher."""
_LINE = 140
SHOWN = (*FILTERS, SHIPPED, POINT_ZONES, RAW, RELATIVE, COMBINED)
"""Columns; what else is measured is in the JSON and in the table of the ways of joining."""


@dataclass(frozen=True)
class Section:
    """A table: ``head`` names the columns of ``lines``, ``note`` says how to read it."""

    title: str
    note: str
    head: list[str]
    lines: list[list[str]]


@dataclass(frozen=True)
class Judged:
    """All that the tables are made of. ``calibration`` is by the name of the scores, ``ways`` the way of combining by
    survey and, under "", on all.
    """

    results: Sequence[PlaceResult]
    measured: Mapping[str, Sequence[Measured]]
    told: Cases
    calibration: Mapping[str, tuple[list[KindCalibration], Platt]]
    ways: Mapping[str, str]


def sections(judged: Judged) -> list[Section]:
    """All tables."""
    made = [_by_height(judged, kind) for kind in KINDS if (judged.told.kind == kind).any()]
    made += [_by_a70(judged), _surveys(judged), _false_zones(judged), _changed(judged), _factors(judged)]
    if judged.calibration:
        made.append(_calibration(judged))
    if judged.ways:
        made.append(_ways(judged))
    return made


def _line(judged: Judged, title: str, chosen: Bool, level: str = "others") -> list[str]:
    told = judged.told
    return [f"{title}, {chosen.sum()}", *(str(share(told.found[name][level][:, chosen])) for name in _shown(judged))]


def _by_height(judged: Judged, kind: str) -> Section:
    told = judged.told
    mine = told.kind == kind
    lines = [_line(judged, "nothing put in", mine & (told.height == 0))]
    for height in HEIGHTS_M:
        lines.append(_line(judged, f"{height:g} m high", mine & (np.abs(told.height - height) < 1e-9)))
    for diameter in DIAMETERS_M:
        wide = mine & (told.height > 0) & (np.abs(told.diameter - diameter) < 1e-6)
        if wide.any():
            lines.append(_line(judged, f"{diameter:g} m wide", wide))
    note = (
        "Found at the level for one false zone per 1,000 m² of the untouched ground of the other surveys; 95 % "
        "interval, and the range of the seeds after a semicolon. 'Nothing put in' is what is found by chance."
    )
    return Section(f"Hazards found on {KINDS[kind]}", note, _head(judged, "hazards, number"), lines)


def _by_a70(judged: Judged) -> Section:
    told = judged.told
    dense = (told.kind == POINTS) & (told.density >= MIN_DENSITY)
    parts = {
        f"real clouds >= {MIN_DENSITY:g} points/m²": dense,
        "all": np.ones(len(told.height), dtype=bool),
        **{title: told.kind == kind for kind, title in KINDS.items() if kind != POINTS},
    }
    lines = []
    for title, mine in parts.items():
        for low, high in itertools.pairwise(NEEDED_EDGES):
            bounds = f"{low:g} to {high:g}" if math.isfinite(high) else f"above {low:g}"
            lines.append(_line(judged, f"{title}: {bounds}", mine & (told.ratio >= low) & (told.ratio < high)))
    for bound, aim in AIMS.items():
        chosen = dense & (told.ratio > bound)
        line = _line(judged, f"aim {100 * aim:.0f} % above {bound:g}, dense real clouds", chosen)
        met = [share(told.found[name]["others"][:, chosen]) for name in _shown(judged)]
        lines.append([line[0], *(_with_aim(one, aim) for one in met)])
    note = "A70 is the height that the place needs by its own ground. Aims are told with yes or no."
    return Section("Hazards found by height over A70", note, _head(judged, "height / A70, number"), lines)


def _with_aim(found: Share, aim: float) -> str:
    return f"{found} {'yes' if found.value >= aim else 'no'}" if found.number else "-"


def _surveys(judged: Judged) -> Section:
    told, lines = judged.told, []
    for group, mine in _groups(judged).items():
        where = (told.group == group) & (told.height > 0)
        area = sum(one.area for one in mine)
        density = float(np.median([one.place.density for one in mine]))
        a70 = ", ".join(_median(told.needed[where & (np.abs(told.diameter - d) < 1e-6)]) for d in DIAMETERS_M)
        cells = []
        for column in _shown(judged):
            found = told.found[column]["others"]
            shares = [share(found[:, where & (np.abs(told.height - height) < 1e-9)]) for height in SURVEY_HEIGHTS_M]
            cells.append(", ".join(f"{100 * one.value:.0f}" if one.number else "-" for one in shares))
        lines.append([f"{group}, {area:,.0f} m², {density:.0f}/m²; A70 {a70}", *cells])
    heights = ", ".join(f"{height:g}" for height in SURVEY_HEIGHTS_M)
    note = f"Shares in % of hazards of {heights} m; A70 in m of hazards of 2, 3, 5 and 8 m; ground points/m²."
    return Section("Hazards found by survey", note, _head(judged, "survey"), lines)


def _false_zones(judged: Judged) -> Section:
    lines = []
    for group, mine in _groups(judged).items():
        lines.append([group, *_false(judged, mine, "false_others", "area")])
    for kind, title in KINDS.items():
        mine = [one for one in judged.results if one.place.kind == kind]
        if mine:
            lines.append([f"all {title}", *_false(judged, mine, "false_others", "area")])
    note = (
        f"False zones per {PER_M2:,.0f} m² of untouched ground at the level of the others, one for clouds and "
        "simulated slopes together and one for elevation models; the range of the seeds in brackets."
    )
    return Section("False zones where 1 is asked for", note, _head(judged, "survey"), lines)


def _changed(judged: Judged) -> Section:
    told, lines = judged.told, []
    for kind, title in KINDS.items():
        mine = told.kind == kind
        if not mine.any():
            continue
        for height in (0.0, *HEIGHTS_M):
            name = f"{height:g} m high" if height else "nothing put in"
            lines.append(
                _line(judged, f"{title}: {name}", mine & (np.abs(told.height - height) < 1e-9), "changed_others")
            )
        lines.append(_line(judged, f"{title}: all, own level", mine & (told.height > 0), "changed_own"))
        places = [one for one in judged.results if one.place.kind == kind]
        false = _false(judged, places, "false_changed", "changed_area")
        lines.append([f"{title}: false zones of changed ground at the level of untouched ground", *false])
    note = (
        f"Levels by zones of the scenes with hazards that do not come within {NEAR_M:g} m of any: one per "
        f"{PER_M2:,.0f} m² on the other surveys, or on the place itself."
    )
    return Section("Hazards found at the level from changed ground", note, _head(judged, "hazards, number"), lines)


def _factors(judged: Judged) -> Section:
    told, lines = judged.told, []
    parts = {
        "clouds and simulated slopes": told.kind != ELEVATION,
        f"real clouds >= {MIN_DENSITY:g} points/m²": (told.kind == POINTS) & (told.density >= MIN_DENSITY),
        "simulated slopes": told.kind == SIMULATED,
    }
    for title, mine in parts.items():
        for diameter in DIAMETERS_M:
            chosen = mine & (np.abs(told.diameter - diameter) < 1e-6)
            if not chosen.any():
                continue
            texts = [_factor(*a70_factor(told, name, chosen)) for name in _shown(judged)]
            lines.append([f"{title}: {diameter:g} m", *texts])
    note = (
        "A70 times this is the height at which 70 % are found, by a logistic fit over the logarithm of height over "
        "A70; 95 % interval by bootstrap over places. Far from 1 it is an extrapolation."
    )
    return Section("Factors of A70", note, _head(judged, "ground and width"), lines)


def _calibration(judged: Judged) -> Section:
    lines = []
    for name, (kinds, fit) in judged.calibration.items():
        for one in kinds:
            lines.append([f"{name}: {KINDS[one.kind]}", f"{one.before:.4f}", f"{one.after:.4f}", ""])
        lines.append([f"{name}: fit of all", "", "", f"scale {fit.scale:.4f}, shift {fit.shift:.4f}"])
    note = (
        f"Expected calibration error of the probability of a hazard in a cell, where hazards cover "
        f"{100 * HAZARD_SHARE:g} % of the ground; before, and after Platt scaling fitted on the other surveys."
    )
    return Section("Calibration", note, ["scores", "before", "after", "values"], lines)


def _ways(judged: Judged) -> Section:
    told = judged.told
    shown = [name for name in _shown(judged) if name not in (RELATIVE, SHIPPED, COMBINED)]
    names = [name for name in told.found if name not in shown]
    lines = []
    for kind, title in KINDS.items():
        mine = (told.kind == kind) & (told.height > 0)
        places = [one for one in judged.results if one.place.kind == kind]
        if not places:
            continue
        for level, words in (("own", "the place's own level"), ("others", "the level of the others")):
            cells = [str(share(told.found[name][level][:, mine])) for name in names]
            lines.append([f"{title}: all at {words}", *cells])
        cells = [_per_area(judged.measured[name], places, "false_others", "area") for name in names]
        lines.append([f"{title}: false zones at the level of the others", *cells])
    picked = "; ".join(f"{group or 'of all'}: {way}" for group, way in judged.ways.items())
    note = (
        "Relative scores of the raster network and so many times those of the network on points; combined: the way "
        f"that finds most on the other surveys at one false zone of each place's own ground. Chosen: {picked}."
    )
    return Section("Ways of joining both networks", note, ["ground", *names], lines)


def _head(judged: Judged, first: str) -> list[str]:
    return [first, *_shown(judged)]


def _shown(judged: Judged) -> list[str]:
    further = [name for name in judged.told.found if name.startswith(FURTHER)]
    return [*further, *(name for name in SHOWN if name in judged.told.found)]


def _groups(judged: Judged) -> dict[str, list[PlaceResult]]:
    found: dict[str, list[PlaceResult]] = {}
    for one in judged.results:
        found.setdefault(one.place.group, []).append(one)
    return found


def _median(values: np.ndarray) -> str:
    return f"{np.median(values):.2f}" if len(values) and np.isfinite(values).any() else "-"


def _factor(value: float, low: float, high: float) -> str:
    def told(one: float) -> str:
        return f"{one:.2f}" if one <= MAX_FACTOR else f"> {MAX_FACTOR:g}"

    return f"{told(value)} ({told(low)} to {told(high)})" if math.isfinite(value) else "-"


def _false(judged: Judged, places: Sequence[PlaceResult], what: str, area: str) -> list[str]:
    return [_per_area(judged.measured[name], places, what, area) for name in _shown(judged)]


def _per_area(runs: Sequence[Measured], places: Sequence[PlaceResult], what: str, area: str) -> str:
    by_run = [per_area(run, places, what, area) for run in runs]
    seeds = f" ({min(by_run):.1f} to {max(by_run):.1f})" if len(by_run) > 1 else ""
    return f"{np.mean(by_run):.2f}{seeds}"


def per_area(run: Measured, places: Sequence[PlaceResult], what: str, area: str) -> float:
    """Mean over places of one of a run's rates in ``SiteFigures``, weighted by one of its areas."""
    listed = [run.figures[one.place.name] for one in places]
    weights = [getattr(one, area) for one in listed]
    return float(np.average([getattr(one, what) for one in listed], weights=weights)) if sum(weights) else math.nan


def text(made: Sequence[Section], heading: Callable[[], str]) -> str:
    """The tables as Markdown, with notes in lines as long as those of all documents."""
    parts = [heading()]
    for one in made:
        table = [one.head, *one.lines]
        widths = [max(len(line[k]) for line in table) for k in range(len(one.head))]
        lines = [
            "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |"
            for line in table
        ]
        lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
        note = textwrap.fill(one.note, _LINE, break_on_hyphens=False)
        parts.append(f"## {one.title}\n\n{note}\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)
