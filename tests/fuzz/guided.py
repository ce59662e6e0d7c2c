"""Coverage-guided fuzzing of one reader with atheris (libFuzzer), where it is installed.

``python -m slopewatch.tests.fuzz.guided cloud.las -max_total_time=60`` ends with another code than 0 at the first file
that is neither taken nor refused in one sentence; it lies next to the program then, and libFuzzer's own options apply.
atheris is no part of the locked environment, because its wheels are for few systems: ``pip install atheris``.
"""

from __future__ import annotations

import random
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["slopewatch"]):
    from slopewatch.tests.fuzz import readers

MEMORY_MB, LONGEST_S = 2500, 20


def main() -> None:
    name = sys.argv.pop(1)
    with tempfile.TemporaryDirectory(prefix="guided-") as scratch:
        corpus, path = Path(scratch) / "corpus", Path(scratch) / name
        corpus.mkdir()
        sound = readers.sound_files(Path(scratch))[name]
        (corpus / "sound").write_bytes(sound)
        change = readers.READERS[name][1]

        def custom(data: bytes, size: int, seed: int) -> bytes:
            """Half of the time by the structure of the file, half as libFuzzer does."""
            rng = random.Random(seed)
            if rng.random() < 0.5:
                return bytes(atheris.Mutate(data, size))
            try:
                return change(data if rng.random() < 0.7 else sound, rng)[:size]
            except (
                ValueError,
                IndexError,
                TypeError,
                RecursionError,
            ):  # what it was changed to is no longer of that structure
                return change(sound, rng)[:size]

        def one(data: bytes) -> None:
            path.write_bytes(data)
            readers.refusal(name, path)

        limits = [f"-rss_limit_mb={MEMORY_MB}", f"-timeout={LONGEST_S}", f"-max_len={max(4096, 2 * len(sound))}"]
        atheris.Setup([sys.argv[0], *limits, *sys.argv[1:], str(corpus)], one, custom_mutator=custom)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
