"""Damages a cloud in many places and reads it, within limits of memory and time; prints the outcomes as JSON.

Run as a program by test_damaged_clouds.py, because a reader that crashes or eats all memory must not take the tests
along:
``python fuzz_clouds.py CLOUD SCRATCH CASES SEED``.
"""

from __future__ import annotations

import collections
import json
import resource
import runpy
import sys
import time
from pathlib import Path

MEMORY = 3 << 30
FEW, DISTANCE = 20, 0.05


def main(source: Path, scratch: Path, cases: int, seed: int) -> None:
    """Print ``{"outcomes": {kind: {outcome: count}}, "slowest": seconds, "odd": [...]}``."""
    runpy.run_path(str(Path(__file__).parents[1] / "conftest.py"))
    import numpy as np
    from slopewatch.engine.core.errors import InputError
    from slopewatch.engine.pointcloud.reading import read_cloud
    from slopewatch.interface.parameters import InputParameters

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    inputs = InputParameters(crs="EPSG:32651")
    good = source.read_bytes()
    truth = read_cloud(source, inputs)
    points = int.from_bytes(good[96:100], "little")
    rng = np.random.default_rng(seed)
    kinds = {
        "header": (0, 375),
        "records": (375, points),
        "start of points": (points, points + 100),
        "points": (points, len(good)),
        "end": (len(good) - 40, len(good)),
        "truncated": (0, len(good)),
        "overwritten": (0, len(good)),
    }
    outcomes: dict[str, collections.Counter[str]] = {kind: collections.Counter() for kind in kinds}
    odd, slowest = [], 0.0
    for case in range(cases):
        kind = list(kinds)[case % len(kinds)]
        data = bytearray(good)
        place = int(rng.integers(*kinds[kind]))
        if kind == "truncated":
            del data[place:]
        elif kind == "overwritten":
            data[place : place + 32] = rng.bytes(len(data[place : place + 32]))
        else:
            data[place] ^= 1 << int(rng.integers(8))
        scratch.write_bytes(data)
        started = time.process_time()
        try:
            cloud = read_cloud(scratch, inputs)
        except InputError as error:
            outcome = "refused" if "\n" not in str(error) and "fuzzed" in str(error) else f"unclear: {error}"
        except BaseException as error:
            outcome = f"crash: {type(error).__name__}: {error}"
        else:
            moved = len(cloud) != len(truth)
            if not moved:
                moved = int((np.abs(cloud.xyz - truth.xyz).max(axis=1) > DISTANCE).sum())
            said = "few moved unnoticed" if moved <= FEW else "many moved unnoticed"
            said = "said" if cloud.notes != truth.notes else said
            outcome = said if moved else "as before"
            outcome = outcome if np.isfinite(cloud.xyz).all() else "not finite"
        slowest = max(slowest, time.process_time() - started)
        outcomes[kind][outcome] += 1
        if outcome not in ("refused", "as before", "said") and len(odd) < 20:
            odd.append([case, kind, place, outcome])
    print(json.dumps({"outcomes": outcomes, "slowest": slowest, "odd": odd}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
