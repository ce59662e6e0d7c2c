"""What a slope lets anyone find: how high hazards must be, from place to place, and the sentence that says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engine.core.arrays import Float, Float32
from ..preparation.relief_raster import CELL_M, ReliefRaster
from ..preparation.smallest_hazard import NETWORK_FACTORS, RELIEF_FACTORS, smallest_hazard

USUAL_HAZARD_M = 1.0
"""Where no hazard of this height can be found, nothing that screening is made for can be."""
DOUBTFUL_SHARE = 0.45
"""Part of the slope on which a hazard of ``USUAL_HAZARD_M`` is not found beyond which zones come with a warning. On
places of which 46 to 98 % was blind the filter found 12 to 25 % of hazards of 1.2 m, on those up to 41 %, 38 to 100."""
PARTS: dict[str, dict[float, float] | None] = {"filter": None, "relief": RELIEF_FACTORS, "network": NETWORK_FACTORS}
"""Methods for which was measured what they find, and what they need as parts of what the filter does."""
MAX_BLIND_SHARE = {"filter": DOUBTFUL_SHARE, "relief": 0.85, "network": 0.85, "residual": 0.85}
"""Beyond it a method shows no zones. Others than the filter may see more where hazards and structures themselves make
the ground rough: on a simulated slope blind by 79 % the network showed 34 zones, 2 of them false. On real ground blind
by 89 and 98 % nothing found anything."""
PART_M = CELL_M / 2
"""Side of the voxels whose averages stand for the points of a cell."""
SENTENCE_WIDTH_M = 3.0


@dataclass(frozen=True)
class Detectability:
    """Heights (m) that hazards of ``diameters`` (m) need to be found at 70 % by ``method``, or by the matched filter
    where that is not one of ``PARTS``, at ``false_zones`` false zones per 1,000 m².

    ``heights`` (diameters, m) are those at the voxels, NaN where nothing can be said. Over the cells of the slope:
    ``medians`` (diameters,), NaN where nothing is known; ``short_shares`` (diameters,), the part on which
    ``USUAL_HAZARD_M`` is not enough; ``blind_share``, the part on which it is not at any width, NaN where nothing is
    known.
    """

    diameters: tuple[float, ...]
    heights: Float32
    false_zones: float
    medians: Float
    short_shares: Float
    blind_share: float
    method: str

    @property
    def shown(self) -> bool:
        """Whether the method's zones say anything on this slope."""
        return not self.blind_share > MAX_BLIND_SHARE[self.method]

    @property
    def finder(self) -> str:
        """Whose figures these are."""
        return "screening" if self.method in PARTS else "a matched filter"

    @property
    def doubtful(self) -> bool:
        """Whether zones are to be doubted, though they are shown."""
        return self.blind_share > DOUBTFUL_SHARE

    def figures(self) -> dict[str, Any]:
        """For the record: by width, and over all widths."""
        by_width = {
            f"{diameter:g}": {"median": float(median), "share_above_1_m": float(short)}
            for diameter, median, short in zip(self.diameters, self.medians, self.short_shares, strict=True)
        }
        return {"smallest_hazard_m": by_width, "blind_share": self.blind_share}

    def sentence(self) -> str:
        """What can be found, in one sentence or two; methods that were not measured find no more, as a rule."""
        by_width = dict(zip(self.diameters, self.medians.tolist(), strict=True))
        main = by_width.pop(SENTENCE_WIDTH_M, np.nan)
        if not np.isfinite(main):
            return (
                "How high a hazard must be to be found cannot be said here: too little ground lies around each place."
            )
        others = "; ".join(f"{width:g} m: {_metres(value)}" for width, value in by_width.items() if np.isfinite(value))
        found = (
            f"On half of this slope a hazard {SENTENCE_WIDTH_M:g} m wide must stand {_metres(main)} out of or below "
            f"the ground around it to be found by {self.finder}{f' ({others})' if others else ''}."
        )
        blind = f"{100 * self.blind_share:.0f}"
        nowhere = f"On {blind} % of it even {USUAL_HAZARD_M:g} m is not enough."
        return found if blind == "0" else f"{found} {nowhere}"

    def hidden_sentence(self, name: str) -> str:
        """Why no zones are shown of the cloud ``name``."""
        return (
            f"{name} gets no zones: {self._blind()}; compare two surveys instead, or give any_relief to see zones all "
            "the same."
        )

    def doubt_sentence(self, name: str) -> str:
        """Why the zones of the cloud ``name`` say little."""
        return f"{name} gets zones that say little: {self._blind()}, unless hazards themselves make it so rough."

    def _blind(self) -> str:
        return (
            f"its ground is so rough or so sparse that on {100 * self.blind_share:.0f} % of it {self.finder} would "
            f"not even find a hazard of {USUAL_HAZARD_M:g} m"
        )


def detectability(raster: ReliefRaster, voxels: Float, false_zones: float, method: str = "filter") -> Detectability:
    """What a method can find on a slope's ground, at voxels (m, 3) of its flat frame too."""
    needed = smallest_hazard(raster, false_zones, PARTS.get(method))
    known = np.isfinite(needed.heights)
    anywhere = known.any(axis=0)
    i, j = raster.index(voxels)
    lowest = np.where(known, needed.heights, np.inf).min(axis=0)[anywhere]
    return Detectability(
        needed.diameters,
        needed.heights[:, i, j],
        false_zones,
        np.array([np.median(one[have]) if have.any() else np.nan for one, have in zip(needed.heights, known)]),
        np.array([1.0 - needed.share_below(USUAL_HAZARD_M, diameter) for diameter in needed.diameters]),
        float(np.mean(lowest > USUAL_HAZARD_M)) if len(lowest) else float("nan"),
        method,
    )


def _metres(value: float) -> str:
    return f"{value:.2f} m" if value < 10 else f"{value:.0f} m"
