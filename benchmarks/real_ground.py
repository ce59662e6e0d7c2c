"""The ground of real vegetation, beside that of simulated plants and as other methods find it.

``python -m slopewatch.benchmarks.real_ground [--no-peers] [NAME ...]`` prints the table: of the clouds whose names hold
one of the given parts alone, and without the peers for a quick look. Heights are over the vendor's ground (a plane
through its eight nearest points) or over the simulation's true surface; no class or label reaches a method.
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
from numpy.typing import NDArray

from .ground_clouds import CASES, Case, Cloud
from .ground_figures import Figures, Record, Target, measured
from .ground_methods import Method, peers, slopewatch
from .peers import PeerMissingError
from .table import Row, heading, markdown

Bool = NDArray[np.bool_]
SHARES = (0.5, 0.25, 0.125)
SLOPES = (0.0, 15.0, 30.0, 45.0, 90.0)
FEWEST = 50
"""Points of the reference that a class of slope must hold to be shown."""
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
class Outcome:
    """Masks (n,) of a method on the clouds of a case and the seconds they took; ``reason`` where there are none."""

    found: tuple[Bool, ...] = ()
    seconds: float = 0.0
    reason: str = ""


def applied(method: Method, clouds: Sequence[Cloud]) -> Outcome:
    """The method on each cloud."""
    start = time.perf_counter()
    try:
        found = tuple(method.find(cloud.seen) for cloud in clouds)
    except PeerMissingError as error:
        return Outcome(reason=str(error))
    return Outcome(found, time.perf_counter() - start)


def rows(results: Path | None = None, names: Sequence[str] = (), with_peers: bool = True) -> list[Row]:
    """The table.

    Args:
        results: where its figures are kept as CSV, a line for each cloud, part of it and method.
        names: parts of the names of the clouds wanted; all without.
        with_peers: whether other methods are measured too.
    """
    cases = [case for case in CASES if not names or any(name in case.name for name in names)]
    made = {case.name: case.make() for case in cases if not case.missing}
    others = peers() if with_peers else ()
    record = Record()
    outcomes = _all_applied(made, (OWN, *others))
    table: list[Row] = []
    for case in cases:
        if case.missing:
            table.append(Row(case.title, f"not measured: {case.file} is not beside the checkout"))
            continue
        clouds = made[case.name]
        own = outcomes[case.name, OWN.name]
        figures = measured(clouds, own.found)
        record.add(case, "all", OWN.name, figures, own.seconds)
        target = TARGETS.get(case.name)
        table.append(
            Row(
                case.title,
                f"{figures.text(cells=case.simulated)}; {own.seconds:.0f} s",
                target.text() if target else "",
                "",
                target.met(figures) if target else None,
            )
        )
        for method in others:
            if (case.name, method.name) in outcomes:
                table.append(_beside(case, clouds, figures, method, outcomes[case.name, method.name], record))
        table += [_density_row(case, clouds, figures, record), _slope_row(case, clouds, own.found, record)]
    table += _season_rows(record)
    if results is not None:
        record.write(results)
    return table


def _all_applied(made: dict[str, tuple[Cloud, ...]], methods: Sequence[Method]) -> dict[tuple[str, str], Outcome]:
    """What each method found, by names of case and method; those that suit no cloud of a case are left out."""
    pairs = [
        (name, clouds, method)
        for name, clouds in made.items()
        for method in methods
        if all(method.suits(cloud.seen) for cloud in clouds)
    ]
    # the cloth of 0.1 m takes longer than all the rest together, so it is laid beside the rest
    pool = ThreadPoolExecutor(1)
    try:
        slow = {(name, m.name): pool.submit(applied, m, clouds) for name, clouds, m in pairs if m.slow}
        quick = {(name, m.name): applied(m, clouds) for name, clouds, m in pairs if not m.slow}
        return quick | {key: future.result() for key, future in slow.items()}
    finally:
        pool.shutdown(cancel_futures=True)


def _beside(case: Case, clouds: Sequence[Cloud], own: Figures, method: Method, outcome: Outcome, record: Record) -> Row:
    """SlopeWatch's mean height beside that of a peer."""
    title = f"{case.name}: mean height beside {method.name}"
    target = "smaller magnitude" if method.rival else ""
    if outcome.reason:
        return Row(title, f"{own.mean:+.3f} m", target, f"not measured: {outcome.reason}")
    theirs = measured(clouds, outcome.found)
    record.add(case, "all", method.name, theirs, outcome.seconds)
    met = abs(own.mean) < abs(theirs.mean) if method.rival and theirs.points else None
    return Row(title, f"{own.mean:+.3f} m", target, theirs.text(cells=case.simulated), met)


def _density_row(case: Case, clouds: Sequence[Cloud], whole: Figures, record: Record) -> Row:
    """SlopeWatch on the clouds with fewer pulses."""
    found = [whole]
    for share in SHARES:
        thinner = [cloud.thinned(share) for cloud in clouds]
        outcome = applied(OWN, thinner)
        found.append(measured(thinner, outcome.found))
        record.add(case, f"density {share:g}", OWN.name, found[-1], outcome.seconds)
    density = np.mean([cloud.seen.density for cloud in clouds])
    parts = ", ".join(f"1/{1 / share:.0f}" for share in SHARES)
    return Row(
        f"{case.name}: all of its {density:.0f} returns/m², {parts} of the pulses", in_series(found, case.simulated)
    )


def _slope_row(case: Case, clouds: Sequence[Cloud], masks: Sequence[Bool], record: Record) -> Row:
    """SlopeWatch by the slope of the reference."""
    found, parts = [], []
    for low, high in pairwise(SLOPES):
        inside = [(cloud.slope >= low) & (cloud.slope < high) for cloud in clouds]
        if sum(np.count_nonzero(cloud.ground & part) for cloud, part in zip(clouds, inside, strict=True)) < FEWEST:
            continue
        parts.append(f"{low:g} to {high:g}")
        found.append(measured(clouds, masks, inside))
        record.add(case, f"slope {parts[-1]}", OWN.name, found[-1])
    return Row(f"{case.name}: slopes of {', '.join(parts)} degrees", in_series(found, case.simulated))


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


def _season_rows(record: Record) -> list[Row]:
    """How much higher the ground of grown grass lies than that of mown grass: change that is grass."""
    found: dict[tuple[object, object], object] = {
        (line["cloud"], line["method"]): line["bias"] for line in record.lines if line["part"] == "all"
    }
    table = []
    for density in (700, 40):
        texts = {}
        for (cloud, method), bias in found.items():
            mown = found.get((f"grass_mown_{density}", method))
            if cloud == f"grass_grown_{density}" and mown is not None:
                texts[method] = f"{float(str(bias)) - float(str(mown)):+.3f} m"
        own = texts.pop(OWN.name, "")
        if own:
            peer = "; ".join(f"{name}: {text}" for name, text in texts.items())
            table.append(Row(f"grass of {density}/m²: bias of cells grown less mown", own, "", peer))
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m slopewatch.benchmarks.real_ground")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(case.name for case in CASES))
    parser.add_argument("--no-peers", action="store_true", help="SlopeWatch alone")
    options = parser.parse_args()
    print(heading())
    print(markdown("The ground of real vegetation", rows(None, options.names, not options.no_peers)))
