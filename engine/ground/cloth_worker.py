"""Child process: the CSF authors' library on an array of points.

Started as a file with one argument, a folder. It reads ``points.npy`` (n, 3) and ``parameters.json`` there and writes
``ground.npy`` (n,) bool. A process of its own, because the library holds the interpreter's lock while it works, prints
on standard output, and may take memory without end.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main() -> int:
    here = Path(__file__).resolve().parent
    # other modules of this folder have names of libraries
    sys.path[:] = [p for p in sys.path if not p or Path(p).resolve() != here]
    import CSF
    import numpy as np

    folder = Path(sys.argv[1])
    options = json.loads((folder / "parameters.json").read_text(encoding="utf-8"))
    points = np.load(folder / "points.npy")
    cloth = CSF.CSF()
    cloth.params.bSloopSmooth = options["slope_smoothing"]
    cloth.params.cloth_resolution = options["cloth_resolution"]
    cloth.params.rigidness = options["rigidness"]
    cloth.params.time_step = options["time_step"]
    cloth.params.class_threshold = options["threshold"]
    cloth.params.interations = options["iterations"]
    cloth.setPointCloud(points)
    ground, rest = CSF.VecInt(), CSF.VecInt()
    cloth.do_filtering(ground, rest, False)
    mask = np.zeros(len(points), dtype=bool)
    mask[np.array(ground, dtype=np.int64)] = True
    np.save(folder / "ground.npy", mask)
    return 0


if __name__ == "__main__":
    sys.exit(main())
