"""Whether ground that changed is ground again: patches put into the later of two raw strips, through ``inspect``.

A place is looked at if the vendor's (or the simulation's) ground has three points or more in the middle of the patch in
both surveys. It is found if our ground is right beside half of those points. A single pair:
``python -m slopewatch.lab.benchmarks.ground_changed NAME [SEED ...]``; ``NAMES`` lists them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float
from ...interface.seen import REACH_M
from .changes_in_strips import GAP_M, PAIRS, SIMULATED, SIMULATED_CRS, Survey, _simulated, _written
from .patches import Patch, placed
from .table import Row, say
from .watched import exit_of

THINNED, RIDGED = " thinned", " ridged"
"""End the name of a pair of which a random share of the returns is left, or to which ridges are added."""
LEFT = 0.45
RIDGE_M, BETWEEN_RIDGES_M = 1.0, 14.0
"""Amplitude of the ridges, whose flanks so have 24 degrees, and distance between them."""
NAMES = (
    *("british_columbia", "british_columbia north", "chablais", "coromandel", "simulated shrubs"),
    *("british_columbia thinned", "chablais thinned", "british_columbia ridged", "chablais ridged"),
)
SEEDS = (101, 102, 103)
SIZES = tuple((sign * height, radius) for radius in (4.0, 3.0, 2.0) for height in (0.5, 0.3, 0.2) for sign in (-1, 1))
"""Heights and radii of the patches that are tried in each run, m, the wider first."""
MAX_OFF_M = 0.15
FAR_M = 0.3
MIN_FOUND = 0.8


@dataclass(frozen=True)
class Place:
    """A patch: of the vendor's points in its middle the share beside which our ground is right, and is at all."""

    patch: Patch
    right: float
    any: float

    @property
    def found(self) -> bool:
        return self.right >= 0.5

    @property
    def wrong(self) -> bool:
        return self.any - self.right >= 0.5


@dataclass(frozen=True)
class Outcome:
    """Of one run: the places, and of all ground of the later survey how much lies farther than ``FAR_M`` off."""

    places: list[Place]
    far: float


def rows() -> list[Row]:
    """Places found of each pair, real ones first."""
    table = []
    for name in NAMES:
        outcomes = list(_runs(name, SEEDS))
        places = [place for outcome in outcomes for place in outcome.places]
        if not places:
            continue
        found, wrong = sum(place.found for place in places), sum(place.wrong for place in places)
        far = np.mean([outcome.far for outcome in outcomes])
        said = f"{found} of {len(places)}; wrong ground at {wrong}; of all ground {far:.1%} more than {FAR_M} m off"
        table.append(Row(name, said, f">= {MIN_FOUND:.0%}", "", found >= MIN_FOUND * len(places)))
    return table


def _runs(name: str, seeds: Sequence[int]) -> Iterator[Outcome]:
    """Of each seed; none if the data are missing."""
    kept = name.removesuffix(THINNED).removesuffix(RIDGED)
    pair = next((p for p in PAIRS if p.name == kept), None)
    if pair is not None and pair.missing:
        return
    first, second, slope = pair.load() if pair else _simulated(SIMULATED[kept])
    if name.endswith(THINNED):
        first, second = (_thinned(survey, number) for number, survey in enumerate((first, second)))
    elif name.endswith(RIDGED):
        first, second = (_ridged(survey) for survey in (first, second))
    grounds = [survey.xyz[survey.ground] for survey in (first, second)]
    for seed in seeds:
        patches = placed(SIZES, grounds, np.random.default_rng([seed, 331]), GAP_M, slope)
        later = second.changed(patches)
        with tempfile.TemporaryDirectory() as folder:
            paths = _written((first, later), slope, pair.crs if pair else SIMULATED_CRS, Path(folder))
            dates = f"2024-05-01={paths.first}", f"2024-06-01={paths.second}"
            arguments = ["--epoch", dates[0], "--epoch", dates[1], "--roi", str(paths.roi)]
            code, said = exit_of(["inspect", *arguments, "--output-dir", str(paths.results)])
            if code:
                raise RuntimeError(said)
            ours = np.array(laspy.read(paths.results / "clouds" / "2024-06-01_ground.laz").xyz)
        outcome = _outcome(patches, ours, later.xyz[later.ground])
        hits = ", ".join(
            f"{p.patch.height:+g} x {2 * p.patch.radius:g} {'yes' if p.found else f'no ({p.right:.0%}, {p.any:.0%})'}"
            for p in outcome.places
        )
        found = sum(place.found for place in outcome.places)
        say(f"{name}, seed {seed}: {found} of {len(patches)}, far {outcome.far:.2%}: {hits}")
        yield outcome


def _thinned(survey: Survey, seed: int) -> Survey:
    left = np.random.default_rng([seed, 332]).random(len(survey.xyz)) < LEFT
    return replace(survey, **{name: values[left] for name, values in vars(survey).items()})


def _ridged(survey: Survey) -> Survey:
    along = survey.xyz[:, :2] @ [0.8, 0.6]
    ridges = RIDGE_M * np.sin(2.0 * np.pi * along / BETWEEN_RIDGES_M)
    return replace(survey, xyz=survey.xyz + ridges[:, None] * [0.0, 0.0, 1.0])


def _outcome(patches: Sequence[Patch], ours: Float, vendors: Float) -> Outcome:
    """Of our ground (n, 3) and the vendor's (m, 3) of the later survey, m."""
    middle = vendors.mean(axis=0)
    local, xy = vendors - middle, ours[:, :2] - middle[:2]
    height = LinearNDInterpolator(local[:, :2], local[:, 2])(xy)
    beyond = np.isnan(height)
    height[beyond] = NearestNDInterpolator(local[:, :2], local[:, 2])(xy[beyond])
    off = ours[:, 2] - middle[2] - height
    near = [cKDTree(some[:, :2]).query(vendors[:, :2])[0] <= REACH_M for some in (ours[np.abs(off) <= MAX_OFF_M], ours)]
    inside = [patch.away(vendors) <= patch.radius / 2 for patch in patches]
    shares = [[float(seen[there].mean()) for seen in near] for there in inside]
    places = [Place(patch, *share) for patch, share in zip(patches, shares, strict=True)]
    return Outcome(places, float((np.abs(off[~beyond]) > FAR_M).mean()))


if __name__ == "__main__":
    for _ in _runs(sys.argv[1], [int(seed) for seed in sys.argv[2:]] or SEEDS):
        pass
