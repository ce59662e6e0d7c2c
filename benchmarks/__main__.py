"""Run the benchmarks and print their tables: ``python -m slopewatch.benchmarks [NAME ...]``."""

from __future__ import annotations

import importlib
import sys
import time

from .table import heading, markdown

NAMES = {
    "controlled_test": "The published controlled test, simulated",
    "ground": "Ground extraction",
    "registration": "Registration",
    "gridding": "Gridding",
    "m3c2": "M3C2",
    "calibration": "Calibration of the level of detection",
    "adaptive": "Cells that grow",
    "volumes": "Volumes",
    "detection": "What is detected: pairs with and without change",
    "whole_flow": "The whole flow",
    "series": "More than two surveys",
    "screening": "Screening",
    "known_places": "What a screening could tell by height",
    "real_screening": "Screening of real slopes with known hazards put in",
}


def main(names: list[str]) -> int:
    """Print one table after the other; 1 if a target was missed."""
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        print(f"No benchmark {unknown[0]!r}; there are {', '.join(NAMES)}.", file=sys.stderr)
        return 2
    print(heading(), flush=True)
    missed = False
    for name in names or NAMES:
        started = time.monotonic()
        print(f"running {name} ...", file=sys.stderr, flush=True)
        rows = importlib.import_module(f"{__package__}.{name}").rows()
        print(markdown(NAMES[name], rows), flush=True)
        print(f"{name} took {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
        missed = missed or any(row.met is False for row in rows)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
