"""Coverage-guided fuzzing of one reader with atheris (libFuzzer), where it is installed.

``python -m slopewatch.lab.fuzz.guided cloud.las -max_total_time=60`` ends with another code than 0 at the first file
that is neither taken nor refused in one sentence; libFuzzer's own options apply. Each file is written under
``build/fuzz/guided/NAME`` before the reader gets it, so that what stopped the fuzzer is there however it ended:
``last-NAME`` is the file that was being read, ``crash-...`` (``timeout-``, ``oom-``) what libFuzzer kept itself, and
``mutator-...`` what could not be changed. ``python -m slopewatch.lab.fuzz.guided cloud.las FILE`` repeats one.
atheris is no part of the locked environment, because its wheels are for few systems: ``pip install atheris``.
"""

from __future__ import annotations

import hashlib
import random
import sys
import tempfile
import traceback
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["slopewatch"]):
    from slopewatch.lab.fuzz import readers

MEMORY_MB, LONGEST_S = 2500, 20
KEPT = Path(__file__).resolve().parents[2] / "build" / "fuzz" / "guided"


def main() -> None:
    name = sys.argv.pop(1)
    if len(sys.argv) == 2 and not sys.argv[1].startswith("-"):
        print(repeat(name, Path(sys.argv[1])))
        return
    kept = KEPT / name
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="guided-") as scratch:
        fuzz(name, kept, Path(scratch))


def repeat(name: str, file: Path) -> str:
    """What the reader says of one file; raises what it raises."""
    with tempfile.TemporaryDirectory(prefix="guided-") as scratch:
        readers.sound_files(Path(scratch))
        path = Path(scratch) / name
        path.write_bytes(file.read_bytes())
        return readers.refusal(name, path) or "accepted"


def fuzz(name: str, kept: Path, scratch: Path) -> None:
    """Never returns: libFuzzer ends the process. What is in ``scratch`` may stay behind."""
    corpus, last = scratch / "corpus", kept / f"last-{name}"
    corpus.mkdir()
    sound = readers.sound_files(scratch)[name]
    (corpus / "sound").write_bytes(sound)
    for path in scratch.glob(f"{Path(name).stem}.*"):  # the weights of a description
        (kept / f"last-{path.name}").write_bytes(path.read_bytes())
    change = readers.READERS[name][1]

    def custom(data: bytes, size: int, seed: int) -> bytes:
        """Half of the time by the structure of the file, half as libFuzzer does."""
        rng = random.Random(seed)
        if rng.random() < 0.5:
            return bytes(atheris.Mutate(data, size))
        try:
            return change(data if rng.random() < 0.7 else sound, rng)[:size]
        except (ValueError, IndexError, TypeError, RecursionError):  # data are no longer of that structure
            return change(sound, rng)[:size]
        except Exception:  # a fault of the fuzzer must not end it without what led there
            text = f"seed {seed}\n{traceback.format_exc()}"
            mark = hashlib.sha256(data).hexdigest()[:12]
            (kept / f"mutator-{mark}").write_bytes(data)
            (kept / f"mutator-{mark}.txt").write_text(text, encoding="utf-8")
            return change(sound, rng)[:size]

    def one(data: bytes) -> None:
        last.write_bytes(data)
        readers.refusal(name, last)

    limits = [f"-rss_limit_mb={MEMORY_MB}", f"-timeout={LONGEST_S}", f"-max_len={max(4096, 2 * len(sound))}"]
    own = [f"-artifact_prefix={kept}/"]
    atheris.Setup([sys.argv[0], *limits, *own, *sys.argv[1:], str(corpus)], one, custom_mutator=custom)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
