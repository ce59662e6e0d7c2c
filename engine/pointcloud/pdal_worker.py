"""Child process: runs a pipeline through the ``pdal`` Python package, or prints the version of PDAL under it.

Started as a file, outside of the package, so that ``import pdal`` finds the library and no module of this folder.
Reads ``{"pipeline": [...]}`` on standard input.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main() -> int:
    here = Path(__file__).resolve().parent
    sys.path[:] = [p for p in sys.path if not p or Path(p).resolve() != here]
    import pdal

    if sys.argv[1:] == ["--version"]:
        sys.stdout.write(str(pdal.info.version))
        return 0
    pipeline = pdal.Pipeline(json.dumps(json.load(sys.stdin)["pipeline"]))
    try:
        if getattr(pipeline, "streamable", False):
            pipeline.execute_streaming(chunk_size=10_000)
        else:
            pipeline.execute()
    except RuntimeError as error:
        sys.stderr.write(f"PDAL: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
