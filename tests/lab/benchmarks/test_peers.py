"""Arrays go to a peer's script and come back."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from slopewatch.lab.benchmarks import peers

SCRIPT = """
import json, sys
import numpy as np
folder, factor = sys.argv[1], float(sys.argv[2])
first, second = (np.load(f"{folder}/{name}.npy") for name in ("first", "second"))
if factor:
    np.save(f"{folder}/peer.npy", factor * first + second)
print("not this line")
print(json.dumps({"points": len(first)}))
"""


def test_arrays_and_numbers_reach_the_script_and_its_array_comes_back(monkeypatch):
    monkeypatch.setattr(peers, "peer_python", lambda peer: Path(sys.executable))
    first, second = np.arange(6.0).reshape(2, 3), np.ones((2, 3))
    printed, found = peers.run_on_arrays("any", SCRIPT, {"first": first, "second": second}, 2.5)
    assert printed == {"points": 2}
    np.testing.assert_array_equal(found, 2.5 * first + 1)
    assert peers.run_on_arrays("any", SCRIPT, {"first": first, "second": second}, 0.0)[1].size == 0
