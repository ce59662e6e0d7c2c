"""SlopeWatch against other programs, stage by stage: ``python -m slopewatch.lab peers --results FOLDER``.

Each stage has a simulated data set whose truth is known and a real one, and each tool works on the same files in a
process of its own. What was measured is kept in FOLDER/peers.jsonl: a run that is stopped goes on where it stopped.
FOLDER/peers.md and FOLDER/peers.json are made from it. A peer that cannot be installed is a row with the reason.
"""

from __future__ import annotations

import argparse
import importlib
import json
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from datetime import date
from pathlib import Path

from .peer_case import Case, Outcome, Tries, attempt
from .table import heading, machine, say

STAGES = ("registration", "m3c2", "gridding", "difference", "ground", "screening")
REPEATS = 3
Key = tuple[str, str, str, str]


def main(arguments: Sequence[str]) -> int:
    """Measure what is missing, then write the tables."""
    parser = argparse.ArgumentParser(prog="python -m slopewatch.lab peers", description=__doc__)
    parser.add_argument("--results", type=Path, required=True, metavar="FOLDER", help="kept, to go on from")
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=STAGES)
    parser.add_argument("--quick", action="store_true", help="small clouds, once each: to see that all works")
    parser.add_argument("--repeats", type=int, default=0, help=f"runs of each tool (default {REPEATS}; quick 1)")
    options = parser.parse_args(arguments)
    folder = options.results.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    store = folder / ("peers_quick.jsonl" if options.quick else "peers.jsonl")
    known = read(store)
    repeats = options.repeats or (1 if options.quick else REPEATS)
    for stage in options.stages:
        for case in importlib.import_module(f"{__package__}.peer_{stage}").cases(options.quick):
            for outcome in compare(case, repeats, known, lambda row: append(store, row)):
                known[outcome.key] = outcome
    text = heading() + "\n" + table(known.values())
    (folder / store.with_suffix(".md").name).write_text(text, encoding="utf-8")
    document = {"day": date.today().isoformat(), "machine": machine(), "rows": [asdict(row) for row in known.values()]}
    (folder / store.with_suffix(".json").name).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(text)
    return 0


def compare(
    case: Case, repeats: int, known: dict[Key, Outcome], keep: Callable[[Outcome], None] = lambda _: None
) -> list[Outcome]:
    """Outcomes of the tools of a case, which take turns on the same files; none if all are known.

    Args:
        keep: called with each tool's outcome once its last run is done.
    """
    blank = [
        Outcome(case.stage, case.data, tool.name, tool.version, tool.own, day=date.today().isoformat())
        for tool in case.tools
    ]
    if all(outcome.key in known for outcome in blank):
        return []
    tries = [Tries() for _ in case.tools]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "found").mkdir()
        truth = case.prepare(folder)
        for turn in range(repeats):
            for tool, tried, start in zip(case.tools, tries, blank, strict=True):
                if not tried.reason:
                    attempt(case, tool, folder, truth, tried)
                    say(f"{case.stage}, {case.data}, {tool.name}: {tried.reason or f'{tried.cpu:.2f} s'}")
                if turn == repeats - 1:
                    keep(_outcome(start, tried))
    return [_outcome(start, tried) for start, tried in zip(blank, tries, strict=True)]


def _outcome(start: Outcome, tried: Tries) -> Outcome:
    if tried.judged is None or tried.reason:
        return replace(start, reason=tried.reason)
    judged = tried.judged
    return replace(
        start,
        error=judged.value,
        accuracy=judged.text,
        cpu=tried.cpu,
        seconds=tried.seconds,
        peak=tried.peak,
        runs=len(tried.spent),
    )


def table(outcomes: Iterable[Outcome]) -> str:
    """A Markdown table: of each case SlopeWatch first, the others with their figures as multiples of its."""
    lines = [
        "| stage, data | tool | accuracy | processor | clock | peak memory | processor, memory, of SlopeWatch's |",
        "|---|---|---|---|---|---|---|",
    ]
    cases: dict[tuple[str, str], list[Outcome]] = {}
    for outcome in outcomes:
        cases.setdefault((outcome.stage, outcome.data), []).append(outcome)
    for (stage, data), rows in cases.items():
        own = next((row for row in rows if row.own and not row.reason), None)
        for row in sorted(rows, key=lambda row: not row.own):
            start = f"| {stage}, {data} | {row.tool} {row.version} | "
            if row.reason:
                lines.append(f"{start}not measured: {row.reason} | | | | |")
                continue
            share = ""
            if own is not None and row is not own:
                share = f"{row.cpu / own.cpu:.2g} x, {row.peak / own.peak:.2g} x"
            lines.append(
                f"{start}{row.accuracy} | {row.cpu:.2f} s | {row.seconds:.2f} s | {row.peak / 1e9:.2f} GB | {share} |"
            )
    return "\n".join(lines) + "\n"


def read(store: Path) -> dict[Key, Outcome]:
    """What was measured before, without what was not; a line that a kill cut short is left out."""
    found = {}
    for line in store.read_text(encoding="utf-8").splitlines() if store.exists() else ():
        try:
            row = Outcome(**json.loads(line))
        except (json.JSONDecodeError, TypeError):
            continue
        found[row.key] = row
    return found


def append(store: Path, outcome: Outcome) -> None:
    """Keep an outcome, on a line of its own even after one that was cut short."""
    cut = store.exists() and store.stat().st_size > 0 and not store.read_bytes().endswith(b"\n")
    with store.open("a", encoding="utf-8") as file:
        file.write("\n" * cut + json.dumps(asdict(outcome)) + "\n")
