"""Run the benchmarks and print their tables: ``python -m slopewatch.lab [--results FOLDER] [NAME ...]``.

``--results`` keeps what became of each single case as FOLDER/NAME.csv (.jsonl, .json), for the benchmarks
that can (``KEPT``).

``peers --help`` and ``growth --help``: stage by stage against other programs, and with the size of the slope.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

from .benchmarks.table import heading, markdown

NAMES = {
    "controlled_test": "The published controlled test, simulated",
    "ground": "Ground extraction",
    "real_ground": "The ground of real vegetation, and other methods",
    "ground_labels": "Labels of the ISPRS filter samples",
    "plants": "Simulated and real plants",
    "registration": "Registration",
    "sliding_part": "Registration where a part of the slope slid along itself",
    "moving_pieces": "Registration where most of the surface has moved",
    "unstable_series": "Registration of a published series of which most moves",
    "gridding": "Gridding",
    "m3c2": "M3C2",
    "m3c2_zones": "Zones of M3C2 and the ranges of their volumes",
    "m3c2_level": "The level of detection of M3C2",
    "displacement": "Motion along the surface",
    "one_direction": "Motion where relief holds one direction only",
    "movement": "What zones did: slid, sank, bulged, lost or gained material",
    "calibration": "Calibration of the level of detection",
    "strips": "Two airborne strips without change",
    "changes_in_strips": "Changes put into raw strips of forests and slopes",
    "ground_changed": "Ground that changed in raw strips of forests and slopes",
    "objects_in_strips": "Boulders, walls, cars and heaps put into raw strips of forests and slopes",
    "bumps": "Thirty bumps and hollows in real airborne strips",
    "adaptive": "Cells that grow",
    "volumes": "Volumes",
    "detection": "What is detected: pairs with and without change",
    "unseen_surveys": "Surveys that nothing was chosen on",
    "near_level": "Zones near their level of detection",
    "whole_flow": "The whole flow",
    "profile": "Where the processor time goes",
    "seasons": "Grass grown and mown: what is reported where nothing moved",
    "series": "More than two surveys",
    "series_alerts": "Alert levels of series: false alarms and lead times",
    "series_alert_clouds": "Alert levels of still slopes, with grass and without, as clouds",
    "series_motion": "Series whose ground moves along its surface",
    "demchange": "Change between elevation models, beside xDEM",
    "corridor": "A corridor of slopes",
    "screening": "Screening",
    "screening_sites": "Screening of hazards put into real ground, at one false zone per 1,000 m²",
}


KEPT = {
    "demchange", "detection", "displacement", "one_direction", "real_ground", "unseen_surveys", "screening_sites",
    "series_motion",
}  # fmt: skip
"""Benchmarks that can keep their single results."""


COMMANDS = {"peers": "peer_comparison", "growth": "growth"}
"""Benchmarks with options of their own, which run for longer and keep what they measured; by their modules."""


def main(arguments: list[str]) -> int:
    """Print one table after the other; 1 if a target was missed."""
    if arguments and arguments[0] in COMMANDS:
        module = importlib.import_module(f"{__package__}.benchmarks.{COMMANDS[arguments[0]]}")
        return int(module.main(arguments[1:]))
    parser = argparse.ArgumentParser(prog="python -m slopewatch.lab")
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument(
        "--results", type=Path, metavar="FOLDER", help=f"keep single results of {', '.join(sorted(KEPT))}"
    )
    options = parser.parse_args(arguments)
    names: list[str] = options.names
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        print(f"No benchmark {unknown[0]!r}; there are {', '.join(NAMES)}.", file=sys.stderr)
        return 2
    print(heading(), flush=True)
    missed = False
    for name in names or NAMES:
        started = time.monotonic()
        print(f"running {name} ...", file=sys.stderr, flush=True)
        keep = [options.results / f"{name}.csv"] if options.results and name in KEPT else []
        rows = importlib.import_module(f"{__package__}.benchmarks.{name}").rows(*keep)
        print(markdown(NAMES[name], rows), flush=True)
        print(f"{name} took {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
        missed = missed or any(row.met is False for row in rows)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
