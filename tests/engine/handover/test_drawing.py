"""Drawings that are the same bytes in each process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from slopewatch.tests.builders.handed_over import pit

_DRAW = """
import sys
from pathlib import Path
from slopewatch.engine.handover.drawing import write_dxf
from slopewatch.engine.handover.held import read_held
write_dxf(Path(sys.argv[2]), read_held(Path(sys.argv[1])), {}, {})
"""


def test_processes_that_order_sets_differently_write_the_same_bytes(tmp_path: Path) -> None:
    folder, drawn = pit(tmp_path), []
    for seed in (1, 4, 7):  # which order them differently
        path = tmp_path / f"{seed}.dxf"
        command = [sys.executable, "-c", _DRAW, str(folder), str(path)]
        subprocess.run(command, env={**os.environ, "PYTHONHASHSEED": str(seed)}, check=True)
        drawn.append(path.read_bytes())
    assert len(set(drawn)) == 1
