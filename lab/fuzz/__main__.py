"""Fuzz every kind of file that a command reads: ``python -m slopewatch.lab.fuzz --minutes 20 --seed 1 [TARGET ...]``.

Each trial changes a sound file and runs the real command on it in a forked process. A fault is a hang, memory over the
limit, a traceback, another exit code than 0 and 2, a refusal that is not one sentence with the file's name, or
something left behind. Faults are kept under ``build/fuzz`` with the command; the exit code is 1 if there were any.
"""

from __future__ import annotations

import argparse
import random
import shlex
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from slopewatch.lab.fuzz.target import Target
from slopewatch.lab.fuzz.targets import all_targets
from slopewatch.lab.fuzz.trial import fault, run_apart
from slopewatch.tests.builders.program import LOADED

KEPT = Path(__file__).resolve().parents[2] / "build" / "fuzz"
WIDTH = 30


def trial(target: Target, seed: int, kept: Path) -> tuple[str, str]:
    """One changed file: how the command ended, and what is wrong about it (nothing if all is as promised)."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        file, words = target.prepare(folder, random.Random(f"{target.name} {seed}"))
        before = file.read_bytes()
        done = run_apart(words)
        wrong = fault(done, folder / "out", (file.name, str(file.parent), *target.named))
        if wrong:
            place = kept / f"{target.name}-{seed}"
            place.mkdir(parents=True, exist_ok=True)
            (place / file.name).write_bytes(before)
            (place / "why.txt").write_text(f"{wrong}\n{shlex.join(words)}\n{done.error.decode(errors='replace')}\n")
    return {0: "accepted", 2: "refused"}.get(done.code, "failed"), wrong


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzz", description="Damage files at random and run the commands on them.")
    parser.add_argument("targets", nargs="*", help="names, or starts of names; all by default")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--trials", type=int, default=10**9, help="a target at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sound", type=Path, help="folder of the sound files; made there once and used again")
    given = parser.parse_args()
    import importlib

    workflows = (f"slopewatch.workflows.{path.stem}" for path in (KEPT.parents[1] / "workflows").glob("[a-z]*.py"))
    for module in (*LOADED, *workflows, "slopewatch.models.network.unet", "slopewatch.models.screening.method"):
        importlib.import_module(module)
    with tempfile.TemporaryDirectory(prefix="fuzz-seeds-") as folder:
        chosen = tuple(given.targets) or ("",)
        targets = [t for t in all_targets(given.sound or Path(folder)) if t.name.startswith(chosen)]
        return fuzz(targets, given.seed, given.minutes, given.trials)


def fuzz(targets: list[Target], seed: int, minutes: float, trials: int) -> int:
    """Take the targets in turn, so that each gets as many trials; print what came out."""
    shutil.rmtree(KEPT, ignore_errors=True)
    end, number = time.monotonic() + 60 * minutes, 0
    ends: dict[str, Counter[str]] = {t.name: Counter() for t in targets}
    seconds: Counter[str] = Counter()
    while time.monotonic() < end and number < trials:
        for target in targets:
            if time.monotonic() >= end:
                break
            started = time.monotonic()
            how, wrong = trial(target, seed * 1_000_000 + number, KEPT)
            seconds[target.name] += time.monotonic() - started
            ends[target.name][how] += 1
            if wrong:
                ends[target.name]["faults"] += 1
                print(f"{target.name} {seed * 1_000_000 + number}: {wrong}", flush=True)
        number += 1
    print(f"\n{'target':{WIDTH}} trials accepted refused faults  s a trial")
    for name, counts in ends.items():
        total = sum(counts[how] for how in ("accepted", "refused", "failed"))
        row = f"{total:6} {counts['accepted']:8} {counts['refused']:7} {counts['faults']:6}"
        print(f"{name:{WIDTH}} {row}  {seconds[name] / max(total, 1):.2f}")
    faults = sum(counts["faults"] for counts in ends.values())
    print(f"{'all':{WIDTH}} {sum(sum(c.values()) - c['faults'] for c in ends.values()):6} {'':16} {faults:6}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
