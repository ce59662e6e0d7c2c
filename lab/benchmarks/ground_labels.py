"""Wrong labels of the ISPRS filter samples (Sithole and Vosselman 2004), beside those of SMRF.

Single returns of 0.2 to 1 a m², on a steep slope with houses (11), a bridge, ramps, towns, a quarry and an embankment.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import laspy
import numpy as np

from ...engine.core.arrays import Bool
from .ground_clouds import VENDORS_GROUND, Seen
from .ground_methods import slopewatch, smrf
from .real_data import DATA
from .table import Row

SAMPLES = DATA / "isprs"
FEWEST_BETTER = 6
SLOPE_SAMPLE, SLOPE_LIMIT = "samp11", 0.12


def rows() -> list[Row]:
    """Total error of each sample, SMRF beside it, and how often SlopeWatch has the smaller one."""
    samples = sorted(SAMPLES.glob("samp*.laz"))
    if not samples:
        return [Row("ISPRS samples", "not measured: they are not next to the checkout")]
    return list(_rows(samples))


def _rows(samples: list[Path]) -> Iterable[Row]:
    better = 0
    for path in samples:
        seen, truth = sample(path)
        own, peer = total_error(slopewatch(seen), truth), total_error(smrf(seen), truth)
        better += own < peer
        steep = path.stem == SLOPE_SAMPLE
        target = f"{SLOPE_LIMIT:.0%}" if steep else ""
        yield Row(
            f"{path.stem}: wrong labels",
            f"{own:.2%}",
            target,
            f"SMRF {peer:.2%}",
            own <= SLOPE_LIMIT if steep else None,
        )
    yield Row(
        "samples with fewer wrong labels than SMRF",
        f"{better} of {len(samples)}",
        f"{FEWEST_BETTER}",
        "",
        better >= FEWEST_BETTER,
    )


def sample(path: Path) -> tuple[Seen, Bool]:
    """What a method may see of a sample, and which of its points (n,) are ground."""
    las = laspy.read(path)
    one = np.ones(len(las.points), dtype=np.uint8)
    return Seen(np.array(las.xyz), one, one, "ALS"), np.asarray(las.classification) == VENDORS_GROUND


def total_error(found: Bool, truth: Bool) -> float:
    """Share of the points whose label is wrong."""
    return float((found != truth).mean())
