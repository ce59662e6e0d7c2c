#!/usr/bin/env python3
"""Kill commands at random moments and look at the rest: ``lab/kills/kills.py [inspect|series|train ...] --kills 20``.

Each kill is SIGKILL to the program alone, at a random share of the time that it takes undisturbed. Then no process that
it started may live on for long, and no file may look like a result unless the result is whole. The next run starts in
the same folder, over what the killed one left; the last (with ``--finish-each`` one after every kill) ends by itself,
must give what an undisturbed one gives, and leave nothing else behind. Also tried: a disk that is full, a folder that
is removed during the run, and two runs into one folder. The exit code is 1 if anything was found; files of a result
that differ are kept under ``build/kills`` beside those of the undisturbed run.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import runpy
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, "-m", "slopewatch.cli"]
ORPHANS_S = 10.0
"""That a child may live on: it ends when it finds its parent gone."""
FULL_DISK_B = 400_000
KEPT = ROOT / "build" / "kills"
MARK = f"SLOPEWATCH_KILLS={uuid.uuid4().hex}"
"""In the environment of all that is started: children lead sessions of their own, and have no parent afterwards."""
LATER = ("run.json", "report.html", "log.csv", "report.md")
"""Files of a result that hold times, and so differ from run to run."""

Faults = list[str]


def surveys(folder: Path) -> list[Path]:
    """Three small sound clouds of one slope, which sinks."""
    from slopewatch.tests.builders import epoch_pairs

    clouds = []
    for n, sunk in ((1, 0.0), (2, 0.3), (3, 0.5)):
        xyz = epoch_pairs.slope(n, 6000)
        xyz[xyz[:, 0] < epoch_pairs.X + 3, 2] -= sunk
        clouds.append(epoch_pairs.write(folder / f"{2023 + n}-05-01.laz", xyz))
    return clouds


def commands(folder: Path) -> dict[str, list[str]]:
    """Each command on small sound clouds, without its output folder."""
    from slopewatch.simulation.hazard_scenes.scenes import scene
    from slopewatch.simulation.hazard_scenes.write import write_scene

    epochs = [f"--epoch={path.stem}={path}" for path in surveys(folder)]
    scenes = [folder / f"scene {seed}.laz" for seed in (1, 2, 3)]
    for seed, path in enumerate(scenes, 1):
        write_scene(path, scene(seed, "published", area=200.0, density=20.0))
    train = ["--dimension", "truth_class", "--start", "none", "--network", "smoke", "--steps", "20", "--batch", "1"]
    return {
        "inspect": ["inspect", *epochs[:2], "--cell", "0.5", "--screening-method", "filter"],
        "series": ["series", *epochs, "--cell", "0.5", "--ground-ready"],
        "train": ["train", *map(str, scenes), *train, "--threads", "1"],
    }


def start(words: list[str], out: Path) -> subprocess.Popen[bytes]:
    line = [*COMMAND, *words, "--output-dir", str(out), "--overwrite", "--progress", "none"]
    name, _, value = MARK.partition("=")
    return subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=os.environ | {name: value})


def started() -> list[int]:
    """Living processes that a program of this run has started, whatever their parent and session."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                ended = (entry / "stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[0]
                marked = MARK.encode() in (entry / "environ").read_bytes().split(b"\0")
            except OSError:
                continue
            if marked and ended not in "ZX":
                found.append(int(entry.name))
    return found


def orphans() -> Faults:
    """What lives on after its program has ended; to be asked where nothing else of this run is at work."""
    end = time.monotonic() + ORPHANS_S
    while (left := started()) and time.monotonic() < end:
        time.sleep(0.1)
    for process in left:
        os.kill(process, signal.SIGKILL)
    return [f"{len(left)} processes lived on for {ORPHANS_S:g} s"] if left else []


def half_results(out: Path, known: set[str]) -> Faults:
    """Files with names of a result, unless all of it is there; what a training goes on from has its own folder."""
    if not out.exists():
        return []
    there = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file() and not hidden(p, out)}
    there = {name for name in there if not name.startswith("training/")}
    if not there:
        return []
    try:
        record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return [f"{len(there)} files of a result without a record: {sorted(there)[:5]}"]
    missing = [name for name in record["outputs"].values() if not (out / name).exists()]
    missing += sorted(known - there)
    return [f"a record, but no {missing[:5]}"] if missing else []


def hidden(path: Path, out: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(out).parts)


def content(out: Path) -> dict[str, str]:
    """Checksum of each file of a result that does not depend on the clock."""
    return {
        p.relative_to(out).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(out.rglob("*"))
        if p.is_file() and p.name not in LATER and not p.relative_to(out).as_posix().startswith("training/")
    }


def finish(words: list[str], out: Path) -> tuple[int, str, float]:
    began = time.monotonic()
    with start(words, out) as program:
        _, error = program.communicate()
    return program.returncode, error.decode(errors="replace").strip()[-300:], time.monotonic() - began


def killed(words: list[str], folder: Path, kills: int, rng: random.Random, *, each: bool) -> Faults:
    """Kill ``kills`` runs into one folder; let one run after them, or after each of them, come to its end."""
    whole, out, faults = folder / "whole", folder / "out", []
    code, error, seconds = finish(words, out)
    if code:
        return [f"the undisturbed run ended with {code}: {error}"]
    out.rename(whole)  # made under the other name, because some files of a result name its folder
    known, children = set(content(whole)), 0
    for number in range(kills):
        moment = rng.uniform(0.05, 1.0) * seconds
        with start(words, out) as program:
            time.sleep(moment)
            children += len(set(started()) - {program.pid})
            program.kill()
            program.communicate()
        found = [*orphans(), *half_results(out, known)]
        if each or number == kills - 1:
            found += finished_well(words, out, whole)
            shutil.rmtree(out, ignore_errors=True)
        faults += [f"kill {number} after {moment:.2f} of {seconds:.2f} s: {fault}" for fault in found]
        print(f"  kill {number} after {moment:.2f} of {seconds:.2f} s: {len(found)} faults", flush=True)
    print(f"  {kills} kills within {seconds:.1f} s; {children} child processes were at work then", flush=True)
    return faults


def finished_well(words: list[str], out: Path, whole: Path) -> Faults:
    """The run after a kill: it must end well, give what ``whole`` is, and leave nothing else."""
    code, error, _ = finish(words, out)
    faults = [f"the next run ended with {code}: {error}"] if code else []
    left = [p.name for p in out.iterdir() if p.name.startswith(".")]
    faults += [f"left behind: {left}"] if left else []
    expected, made = content(whole), content(out)
    differing = sorted(name for name in expected.keys() | made.keys() if expected.get(name) != made.get(name))
    if differing:
        place = KEPT / f"{out.parent.name}-{uuid.uuid4().hex[:6]}"
        for source, kind in ((whole, "undisturbed"), (out, "after")):
            for name in (n for n in differing if (source / n).exists()):
                (place / kind / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(source / name, place / kind / name)
        faults.append(f"the next run gave another result: {differing[:8]}, kept in {place}")
    return faults


def removed_folder(words: list[str], folder: Path, seconds: float) -> Faults:
    """The output folder goes away while the run is at work."""
    out = folder / "removed"
    with start(words, out) as program:
        time.sleep(seconds)
        shutil.rmtree(out, ignore_errors=True)
        _, error = program.communicate()
    return ended_with_a_sentence(program.returncode, error, (0, 2), "folder removed")


def full_disk(words: list[str], folder: Path) -> Faults:
    """A disk of 400 kB, where one may be mounted."""
    place = folder / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={FULL_DISK_B}", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        print("full disk: none can be mounted here")
        return []
    try:
        with start(words, place / "out") as program:
            _, error = program.communicate()
        faults = ended_with_a_sentence(program.returncode, error, (2,), "full disk")
        left = [str(p.relative_to(place)) for p in place.rglob("*") if "training" not in p.parts]
        return faults + ([f"full disk: left {left[:5]}"] if left and set(left) != {"out"} else [])
    finally:
        subprocess.run(["umount", str(place)], check=True)


def two_at_once(words: list[str], folder: Path) -> Faults:
    """Both with ``--overwrite``: one is refused, or both end one after the other and the result is whole."""
    out = folder / "both"
    with start(words, out) as first, start(words, out) as second:
        errors = [program.communicate()[1] for program in (first, second)]
    faults = half_results(out, set())
    codes = sorted((first.returncode, second.returncode))
    if codes not in ([0, 0], [0, 2]):
        faults.append(f"two at once ended with {codes}: {errors}")
    return faults


def ended_with_a_sentence(code: int, error: bytes, codes: tuple[int, ...], what: str) -> Faults:
    text = error.decode(errors="replace").strip()
    if code not in codes or "Traceback" in text or "Internal failure" in text:
        return [f"{what}: exit code {code}: {text[-300:]}"]
    return []


def main() -> int:
    parser = argparse.ArgumentParser(description="Kill commands at random moments and look at what is left.")
    parser.add_argument("commands", nargs="*", help="inspect, series, train; all by default")
    parser.add_argument("--kills", type=int, default=20, help="of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--finish-each", action="store_true", help="a whole run after every kill, not only the last")
    parser.add_argument("--only-kills", action="store_true", help="without the other troubles")
    given = parser.parse_args()
    runpy.run_path(str(ROOT / "tests" / "conftest.py"))
    found = 0
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        folder = Path(name)
        for command, words in commands(folder).items():
            if given.commands and command not in given.commands:
                continue
            own = folder / command
            own.mkdir()
            tries: list[Callable[[], Faults]] = [
                lambda w=words, f=own, c=command: killed(
                    w, f, given.kills, random.Random(f"{c} {given.seed}"), each=given.finish_each
                ),
                lambda w=words, f=own: full_disk(w, f),
                lambda w=words, f=own: removed_folder(w, f, 4.0),
                lambda w=words, f=own: two_at_once(w, f),
            ]
            tries = tries[:1] if given.only_kills else tries
            faults = [fault for attempt in tries for fault in attempt()]
            others = f"{len(tries) - 1} other troubles"
            print(
                f"{command}: {given.kills} kills, seed {given.seed}, {others}: {len(faults)} faults",
                flush=True,
            )
            for fault in faults:
                print(f"  {fault}", flush=True)
            found += len(faults)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
