"""A program in place of ``slopewatch`` for the tests of a batch: what it does stands in the first cloud it is given.

``done`` writes the record of a run. ``refused SENTENCE`` and ``failed SENTENCE`` end with codes 2 and 1 and that
sentence, ``crashed`` with a segmentation fault. ``killed N``, ``memory N`` do so the first N times and are done then;
``slow`` is done after a second, a real cloud at once. Each start is a line of the file ``starts`` next to the cloud.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

if __name__ != "__main__":
    from slopewatch.workflows.batch.jobs import Job

PROGRAM = (sys.executable, "-I", str(Path(__file__).absolute()))


def job(folder: Path, name: str, does: str) -> Job:
    """A job of a slope that does so; its cloud lies in ``folder``."""
    cloud = folder / f"{name}.laz"
    cloud.write_text(does, encoding="utf-8")
    out = folder / "out" / name / "series"
    return Job(f"task of {name}", name, "series", (("2024-05-01", str(cloud)),), {}, "default", {}, str(out))


def starts(made: Job) -> int:
    """How often the program was started for a job."""
    path = Path(f"{made.epochs[0][1]}.starts")
    return len(path.read_text(encoding="utf-8").splitlines()) if path.exists() else 0


def main(arguments: list[str]) -> int:
    given = dict(a.removeprefix("--").split("=", 1) for a in arguments if a.startswith("--") and "=" in a)
    cloud, out = Path(given["epoch"].partition("=")[2]), Path(given["output-dir"])
    with Path(f"{cloud}.starts").open("a", encoding="utf-8") as file:
        file.write(f"{os.getpid()}\n")
    count = len(Path(f"{cloud}.starts").read_text(encoding="utf-8").splitlines())
    what, _, rest = cloud.read_bytes()[:200].decode("utf-8", "replace").partition(" ")
    say(event="progress", percent=50.0, message="half")
    say(event="log", level="warning", message="odd")
    print("a library prints", flush=True)
    if what in ("refused", "failed"):
        say(event="error", message=rest, code=2)
        return 2 if what == "refused" else 1
    if what == "crashed":
        os.kill(os.getpid(), signal.SIGSEGV)
    if what == "killed" and count <= int(rest):
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "memory" and count <= int(rest):
        say(event="error", message="Memory ran out; clip the cloud.", code=1)
        return 1
    if what == "slow":
        time.sleep(1.0)
    write(out, arguments[0])
    return 0


def write(out: Path, command: str) -> None:
    """A record as of a run of this version, which the batch must be able to read."""
    version = os.environ.get("FAKE_VERSION") or _version()
    (out / "table.csv").write_text("a\n", encoding="utf-8")
    record = {
        "software": f"SlopeWatch {version}", "command": command, "task": os.environ["SLOPEWATCH_TASK"],
        "inputs": [{"role": "epoch 2024-05-01"}], "outputs": {"table": "table.csv", "run": "run.json"}, "metrics": {},
    }  # fmt: skip
    (out / "run.json").write_text(json.dumps(record), encoding="utf-8")


def _version() -> str:
    lines = (Path(__file__).resolve().parents[2] / "metadata.txt").read_text(encoding="utf-8").splitlines()
    return next(line.split("=", 1)[1].strip() for line in lines if line.startswith("version="))


def say(**event: object) -> None:
    print(json.dumps(event), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
