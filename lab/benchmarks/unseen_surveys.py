"""Surveys that no setting was chosen on: raw clouds through ``inspect`` at its defaults, against the known truth.

Slopes of 20 to 70 degrees with 20 to 300 returns a m² and 0 to 90 % plants, shrubs and trees or closed grass, drawn
from a fixed stream; each with none to three known changes. Every survey goes through ``inspect`` as a process of its
own. What came of it is kept as a line of a file, so that an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...interface.parameters import SurveyParameters
from ...simulation.surveys.change import Bump, Change, Plateau, Slump
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from ...simulation.surveys.write import write_pair
from .survey_outcome import Outcome, judged, read_outcomes, refused, write_outcome
from .table import Row, counted, ratio_class, say
from .watched import exit_of, inspect_command

SEEDS = range(9001, 9041)
LENGTH, RUN = 25.0, (14.0, 20.0)
"""Of a slope on the map, along the road and across, m."""
ANGLE, DENSITY, PLANTS = (20.0, 70.0), (20.0, 300.0), (0.0, 0.9)
GRASSY = 0.25
"""Share of the surveys in which the plants are closed grass."""
ROI_SHARE = 0.58
HEIGHT, AREA = (0.08, 0.5), (2.0, 25.0)
"""Of a change, square to the slope, m, and of its footprint on the map, m²."""
MAX_CHANGES = 3
RATIOS = (0.0, 1.0, 2.0, 3.0, math.inf)
"""Limits of the classes of height over level of detection."""
MAX_FALSE_ZONES = 1
HELD = (0.90, 0.99)


def drawn(seed: int) -> tuple[SurveyParameters, tuple[Change, ...]]:
    """The survey ``seed`` and its changes."""
    rng = np.random.default_rng([seed, 31])
    angle, run = rng.uniform(*ANGLE), rng.uniform(*RUN)
    density = math.exp(rng.uniform(*np.log(DENSITY)))
    plants = rng.uniform(*PLANTS)
    grassy = rng.random() < GRASSY
    parameters = SurveyParameters(
        seed=seed,
        points=round(density * LENGTH * run / ROI_SHARE),
        length=LENGTH,
        height=round(run * math.tan(math.radians(angle)), 3),
        angle=round(angle, 2),
        vegetation=0.0 if grassy else round(plants, 3),
        grass=round(plants, 3) if grassy else 0.0,
        offset=round(float(rng.uniform(0.0, 0.5)), 3),
    )
    count = int(rng.integers(0, MAX_CHANGES + 1))
    return parameters, _drawn_changes(rng, count, run, 1.0 / math.cos(math.radians(angle)))


def _drawn_changes(rng: np.random.Generator, count: int, run: float, steepness: float) -> tuple[Change, ...]:
    """Up to ``count`` changes apart from each other; a height is that square to the slope times ``steepness``."""
    placed: list[Change] = []
    for _ in range(100):
        if len(placed) == count:
            break
        height = steepness * math.exp(rng.uniform(*np.log(HEIGHT))) * float(rng.choice((-1.0, 1.0)))
        area = math.exp(rng.uniform(*np.log(AREA)))
        radius, aspect = math.sqrt(area / math.pi), math.sqrt(rng.uniform(0.6, 1.6))
        u, v = float(rng.uniform(2.0, LENGTH - 2.0)), float(rng.uniform(2.0, run - 2.0))
        kind = rng.integers(3)
        change: Change
        if kind == 0:
            change = Plateau(u, v, math.sqrt(area), height, float(rng.uniform(0.0, 90.0)))
        elif kind == 1:
            change = Slump(u, v, 0.7 * radius, 2.8 * radius, abs(height))
        else:
            change = Bump(u, v, radius * aspect, radius / aspect, height)
        west, south, east, north = change.bounds
        within = west > 0.5 and south > 0.5 and east < LENGTH - 0.5 and north < run - 0.5
        if within and all(_apart(change, other) for other in placed):
            placed.append(change)
    return tuple(placed)


def _apart(one: Change, other: Change) -> bool:
    (a, b, c, d), (e, f, g, h) = one.bounds, other.bounds
    return a > g + 1.0 or e > c + 1.0 or b > h + 1.0 or f > d + 1.0


def surveyed(seed: int) -> SimulatedPair:
    """The pair of surveys ``seed``."""
    parameters, changes = drawn(seed)
    return simulate_pair(parameters, changes=changes)


def inspected(seed: int) -> Outcome:
    """What ``inspect`` makes of the survey ``seed``."""
    pair = surveyed(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = write_pair(pair, folder)
        code, said = exit_of(inspect_command(paths, folder / "out"))
        if code:
            return refused(seed, pair, code, said)
        return judged(seed, pair, folder / "out")


def outcomes(seeds: Iterable[int] = SEEDS, keep: Path | None = None) -> list[Outcome]:
    """Of each of ``seeds``, those in the file ``keep`` from there; others are measured and added to it."""
    known = {found.seed: found for found in read_outcomes(keep)} if keep is not None else {}
    found = []
    for seed in seeds:
        if seed not in known:
            known[seed] = inspected(seed)
            if keep is not None:
                write_outcome(keep, known[seed])
        found.append(known[seed])
        say(known[seed].sentence)
    return found


def rows(keep: Path | None = None, seeds: Iterable[int] = SEEDS) -> list[Row]:
    """Failures, false zones, changes found and intervals that hold; ``keep`` is a file of single surveys that were
    measured before, to which the others are added.
    """
    return table(outcomes(seeds, None if keep is None else keep.with_suffix(".jsonl")))


def table(found: Sequence[Outcome]) -> list[Row]:
    """The figures of all surveys."""
    failed = [o for o in found if o.code not in (0, 2)]
    refusals = [o for o in found if o.code == 2]
    done = [o for o in found if o.code == 0]
    unchanged = [o for o in done if not o.changes]
    false = [zone for o in done for zone in o.zones if zone.false]
    lines = [
        Row(
            f"internal failures in {len(found)} surveys",
            str(len(failed)) + "".join(f"; {o.seed}: {o.said}" for o in failed),
            "0",
            f"refused: {len(refusals)}" + "".join(f"; {o.seed}: {o.said}" for o in refusals),
            not failed,
        ),
        Row(
            f"false zones in {len(done)} surveys, of which {len(unchanged)} unchanged",
            str(len(false)) + "".join(f"; {z.area:.1f} m² with confidence {100 * z.confidence:.1f} %" for z in false),
            f"at most {MAX_FALSE_ZONES}",
            f"on the unchanged ones {sum(z.false for o in unchanged for z in o.zones)}",
            len(false) <= MAX_FALSE_ZONES,
        ),
    ]
    changes = [c for o in done for c in o.changes]
    for low, high in pairwise(RATIOS):
        some = [c for c in changes if low <= c.ratio < high]
        lines.append(
            Row(
                f"changes found, height {ratio_class(low, high)} times the level",
                f"{sum(c.found for c in some)} of {len(some)}",
                "all" if low >= 3 else "",
                f"touched by a zone of their sign {sum(c.touched for c in some)}",
                all(c.touched for c in some) if low >= 3 else None,
            )
        )
    zones = [z for o in done for z in o.zones]
    outward = [z for z in zones if not z.held and abs(z.volume) > abs(z.true)]
    lines.append(
        _held_row(
            "footprints whose 95 % interval of volume holds the truth",
            [z.held for z in zones],
            f"of those that do not, {len(outward)} state too large a volume; median error over standard error "
            f"{np.median([abs(z.volume - z.true) / z.error for z in zones]):.2f}"
            if zones
            else "",
        )
    )
    lines.append(
        _held_row(
            "surveys whose 95 % interval of net volume holds the truth, all compared cells",
            [o.net.held for o in done],
            f"unchanged ones {sum(o.net.held for o in unchanged)} of {len(unchanged)}; median error over standard "
            f"error {np.median([abs(o.net.value - o.net.true) / o.net.error for o in done]):.2f}"
            if done
            else "",
        )
    )
    with_zones = [o for o in done if o.zones]
    lines.append(
        _held_row("the same of the zones' net volume", [o.zones_net.held for o in with_zones if o.zones_net], "")
    )
    return lines


def _held_row(name: str, held: list[bool], peer: str) -> Row:
    share = float(np.mean(held)) if held else math.nan
    met = bool(HELD[0] <= share <= HELD[1]) if held else None
    return Row(name, counted(held), f"{100 * HELD[0]:g} to {100 * HELD[1]:g} %", peer, met)
