"""The ground of real vegetation and of simulated plants, also as other methods find it.

``python -m slopewatch.lab.benchmarks.real_ground [--no-peers] [NAME ...]`` prints the table: of the clouds whose
names hold one of the given parts alone, and without the peers for a quick look. Heights are over the vendor's ground
(a plane through its eight nearest points) or over the simulation's true surface; no class or label reaches a method.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...engine.core.arrays import Bool
from .ground_clouds import CASES, Case, Cloud
from .ground_figures import Figures, Result, Target, measured, write_results
from .ground_methods import Method, peers, slopewatch
from .peers import PeerMissingError
from .table import Row, heading, markdown

SHARES = (0.5, 0.25, 0.125)
SLOPES = (0.0, 15.0, 30.0, 45.0, 90.0)
MIN_REFERENCE_POINTS = 50
"""Points of the reference that a class of slope must hold to be shown."""
CLOTHS = 2
"""Slow methods that run at a time."""
OWN = Method("SlopeWatch", slopewatch)
TARGETS = {
    "coromandel_forest": Target(mean=0.40, near=0.6),
    "british_columbia_forest": Target(mean=0.05, p99=0.30, recall=0.9),
    "chablais_forest": Target(mean=0.05, p99=0.30, recall=0.9),
    **{
        f"grass_{state}_{density}": Target(bias=0.02, error=0.03)
        for state in ("grown", "mown")
        for density in (700, 40)
    },
}


@dataclass(frozen=True)
class Job:
    """A method on a part of the clouds of a case: ``all`` of their points, or a share of their pulses."""

    case: str
    part: str
    method: Method
    clouds: tuple[Cloud, ...]

    @property
    def key(self) -> tuple[str, str, str]:
        return self.case, self.part, self.method.name


@dataclass(frozen=True)
class Outcome:
    """Masks (n,) of a method on the clouds of a job and the seconds they took; ``reason`` where there are none."""

    found: tuple[Bool, ...] = ()
    seconds: float = 0.0
    reason: str = ""


def rows(results: Path | None = None, names: Sequence[str] = (), with_peers: bool = True) -> list[Row]:
    """The table.

    Args:
        results: where its figures are kept as CSV, a line for each cloud, part of it and method.
        names: parts of the names of the clouds wanted; all without.
        with_peers: whether other methods are measured too.
    """
    cases = [case for case in CASES if not names or any(name in case.name for name in names)]
    made = {case.name: case.make() for case in cases if not case.missing}
    methods = (OWN, *(peers() if with_peers else ()))
    known = measure_all(made, methods)
    table: list[Row] = []
    for case in cases:
        if case.missing:
            table.append(Row(case.title, f"not measured: {case.file} is not next to the checkout"))
        else:
            table += _case_rows(case, made[case.name], methods, known)
    for density in (700, 40):
        table += season_row(density, methods, known)
    if results is not None:
        write_results(results, known)
    return table


def measure_all(made: dict[str, tuple[Cloud, ...]], methods: Sequence[Method]) -> dict[tuple[str, str, str], Result]:
    """Results by names of case, part and method; methods that do not suit a case are left out of it."""
    jobs = [
        Job(name, "all", method, clouds)
        for name, clouds in made.items()
        for method in methods
        if all(method.suits(cloud.seen) for cloud in clouds)
    ]
    jobs += [
        Job(name, f"density {share:g}", OWN, tuple(cloud.thinned(share) for cloud in clouds))
        for name, clouds in made.items()
        for share in SHARES
    ]
    # the cloths of 0.1 m take longer than all the rest together, so they run in parallel
    pool = ThreadPoolExecutor(CLOTHS)
    try:
        slow = {job.key: pool.submit(applied, job.method, job.clouds) for job in jobs if job.method.slow}
        quick = {job.key: applied(job.method, job.clouds) for job in jobs if not job.method.slow}
        outcomes = quick | {key: future.result() for key, future in slow.items()}
    finally:
        pool.shutdown(cancel_futures=True)
    known: dict[tuple[str, str, str], Result] = {}
    for job in jobs:
        outcome = outcomes[job.key]
        if outcome.reason:
            known[job.key] = Result(reason=outcome.reason)
            continue
        known[job.key] = Result(measured(job.clouds, outcome.found), outcome.seconds)
        if job.method is OWN and job.part == "all":
            known |= _by_slope(job, outcome.found)
    return known


def applied(method: Method, clouds: Sequence[Cloud]) -> Outcome:
    """The method on each cloud."""
    start = time.perf_counter()
    try:
        found = tuple(method.find(cloud.seen) for cloud in clouds)
    except PeerMissingError as error:
        return Outcome(reason=str(error))
    return Outcome(found, time.perf_counter() - start)


def _by_slope(job: Job, masks: Sequence[Bool]) -> dict[tuple[str, str, str], Result]:
    """Results by classes of the reference's slope that hold enough of its points."""
    known = {}
    for low, high in pairwise(SLOPES):
        inside = [(cloud.slope >= low) & (cloud.slope < high) for cloud in job.clouds]
        held = sum(int(np.count_nonzero(c.ground & part)) for c, part in zip(job.clouds, inside, strict=True))
        if held >= MIN_REFERENCE_POINTS:
            key = (job.case, f"slope {low:g} to {high:g}", job.method.name)
            known[key] = Result(measured(job.clouds, masks, inside))
    return known


def _case_rows(
    case: Case,
    clouds: Sequence[Cloud],
    methods: Sequence[Method],
    known: dict[tuple[str, str, str], Result],
) -> list[Row]:
    """SlopeWatch's figures, its mean and the others', its figures by density and by slope."""
    whole = known[case.name, "all", OWN.name]
    own = whole.figures
    assert own is not None
    target = TARGETS.get(case.name)
    value = f"{own.text(cells=case.simulated)}; {whole.seconds:.0f} s"
    table = [Row(case.title, value, target.text() if target else "", "", target.met(own) if target else None)]
    for method in methods:
        result = known.get((case.name, "all", method.name))
        if method is not OWN and result is not None:
            table.append(_peer_row(case, own, method, result))
    parts = {part: r.figures for (name, part, _), r in known.items() if name == case.name and r.figures is not None}
    thinner = [parts[f"density {share:g}"] for share in SHARES]
    density = np.mean([cloud.seen.density for cloud in clouds])
    shares = ", ".join(f"1/{1 / share:.0f}" for share in SHARES)
    table.append(
        Row(
            f"{case.name}: all of its {density:.0f} returns/m², {shares} of the pulses",
            in_series([own, *thinner], case.simulated),
        )
    )
    slopes = {part.removeprefix("slope "): figures for part, figures in parts.items() if part.startswith("slope ")}
    if slopes:
        title = f"{case.name}: slopes of {', '.join(slopes)} degrees"
        table.append(Row(title, in_series(list(slopes.values()), case.simulated)))
    return table


def _peer_row(case: Case, own: Figures, method: Method, result: Result) -> Row:
    """SlopeWatch's mean height and that of a peer."""
    theirs = result.figures
    peer = f"not measured: {result.reason}" if theirs is None else theirs.text(cells=case.simulated)
    met = None
    if method.rival and theirs is not None and theirs.points:
        met = abs(own.mean) < abs(theirs.mean)
    return Row(
        f"{case.name}: mean height, compared with {method.name}",
        f"{own.mean:+.3f} m",
        "smaller magnitude" if method.rival else "",
        peer,
        met,
    )


def season_row(density: int, methods: Sequence[Method], known: dict[tuple[str, str, str], Result]) -> list[Row]:
    """How much higher the ground of grown grass lies than that of mown grass: change that is grass."""
    texts = {}
    for method in methods:
        both = [known.get((f"grass_{state}_{density}", "all", method.name)) for state in ("grown", "mown")]
        grown, mown = (result.figures if result else None for result in both)
        if grown is not None and mown is not None:
            texts[method.name] = f"{grown.bias - mown.bias:+.3f} m"
    own = texts.pop(OWN.name, None)
    if own is None:
        return []
    peer = "; ".join(f"{name}: {text}" for name, text in texts.items())
    return [Row(f"grass of {density}/m²: bias of cells grown less mown", own, "", peer)]


def in_series(found: Sequence[Figures], cells: bool) -> str:
    """One figure after the other, each of all parts; ``cells``: with the bias of the cells' means."""
    texts = [
        "mean " + ", ".join(f"{figures.mean:+.3f}" for figures in found),
        "99 % " + ", ".join(f"{figures.p99:+.2f}" for figures in found),
        "recall " + ", ".join(f"{figures.recall:.2f}" for figures in found),
        "within 20 cm " + ", ".join(f"{100 * figures.near:.0f}" for figures in found) + " %",
    ]
    if cells:
        texts.append("bias of cells " + ", ".join(f"{figures.bias:+.3f}" for figures in found))
    return "; ".join(texts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m slopewatch.lab.benchmarks.real_ground")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(case.name for case in CASES))
    parser.add_argument("--no-peers", action="store_true", help="SlopeWatch alone")
    options = parser.parse_args()
    print(heading())
    print(markdown("The ground of real vegetation", rows(None, options.names, not options.no_peers)))
