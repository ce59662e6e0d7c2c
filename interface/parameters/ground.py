"""Parameters of ground extraction."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, Specification, _parameter


@dataclass(frozen=True)
class GroundParameters(ParameterSet, record_name="ground"):
    """Ground extraction: denoising, the Cloth Simulation Filter (Zhang et al. 2016, doi:10.3390/rs8060501), refinement.

    The cloth gives the seeds, within ``cloth_reach``; the refinement finds the ground from there, from below. Without
    it, points within ``class_threshold`` of the cloth are ground, as published.
    """

    slope_aligned: bool = _parameter(
        True,
        "Rotate the slope flat before filtering",
        "Fits the dominant plane and filters in its frame, so that the cloth does not lose ground on a steep face.",
    )
    cloth_resolution: float = _parameter(
        0.5,
        "Cloth resolution",
        "Distance between the cloth's particles. Larger is faster and smoother, smaller follows finer relief.",
        unit="m",
        bounds=(0.02, 20.0),
    )
    rigidness: int = _parameter(
        1,
        "Cloth rigidness",
        "1 for steep slopes, 2 for terraces, 3 for flat ground. Larger bends less and bridges relief.",
        bounds=(1, 3),
    )
    class_threshold: float = _parameter(
        0.06,
        "Ground threshold",
        "Points within this distance of bare ground's surface (of the cloth, without refinement) are ground. It widens "
        "automatically with the scatter of the ground, and to 0.1 m where returns are few. Larger keeps more low "
        "plants.",
        unit="m",
        bounds=(0.005, 5.0),
    )
    refine: bool = _parameter(
        True,
        "Refine the ground",
        "Follows the lowest layer of returns from seeds near the cloth, so that grass and shrubs are not taken for "
        "ground and places that no return reached stay empty. Off: the cloth alone decides, as published.",
    )
    cloth_reach: float = _parameter(
        0.3,
        "Reach of the cloth",
        "The refinement takes its seeds from points within this distance of the cloth, and from what lies below them. "
        "Larger takes more seeds, also from plants where no pulse reached the ground.",
        unit="m",
        bounds=(0.05, 20.0),
        advanced=True,
    )
    last_returns: bool = _parameter(
        True,
        "Last returns only",
        "Only the last return of a pulse can be ground. Not applied where the cloud's return numbers are implausible.",
        advanced=True,
    )
    strips: str = _parameter(
        "off",
        "Fit flight strips",
        "auto: strips of one survey that disagree where they overlap are fitted to one another: heights, positions and "
        "slow drift over time, as far as that holds on ground that was left out. Only strips of the same survey are "
        "compared, so that change between surveys stays; the error that is stated for the registration lacks that of "
        "the fit. off: they stay as surveyed.",
        choices=("auto", "off"),
        advanced=True,
    )
    time_step: float = _parameter(
        0.65,
        "Time step",
        "Step of the cloth's fall under gravity. Larger settles in fewer iterations and smooths fine relief.",
        bounds=(0.05, 2.0),
        advanced=True,
    )
    iterations: int = _parameter(
        500,
        "Iterations",
        "Upper limit of the cloth's steps; it stops earlier once the cloth rests. Larger only takes longer.",
        bounds=(1, 10000),
        advanced=True,
    )
    slope_smoothing: bool = _parameter(
        False,
        "Slope smoothing of the cloth",
        "CSF's post-processing that pulls the cloth's hanging particles to the ground on steep faces.",
        advanced=True,
    )
    denoise: bool = _parameter(
        True,
        "Remove outliers",
        "Removes isolated points below and above the surface before the cloth falls. One low outlier can otherwise "
        "take all ground away.",
        advanced=True,
    )
    denoise_radius: float = _parameter(
        1.0,
        "Outlier distance",
        "Points this far above or below all others, and five times as far sideways, are isolated. It widens "
        "automatically to three times the spacing of sparse clouds. Larger removes less.",
        unit="m",
        bounds=(0.05, 100.0),
        advanced=True,
    )
    denoise_group: int = _parameter(
        10,
        "Largest group of outliers",
        "Isolated groups of at most this many points are outliers. Larger removes more.",
        bounds=(1, 100000),
        advanced=True,
    )
    minimum_ground_ratio: float = _parameter(
        0.001,
        "Minimum plausible share of ground",
        "Below this share of the clipped points the extraction fails with an error. Larger is stricter.",
        bounds=(0.0, 1.0),
        advanced=True,
    )
    ground_memory: float | str = _parameter(
        AUTO,
        "Memory for the ground",
        "A cloud whose ground takes more is worked on in tiles, which gives the same ground but for a few points at "
        "the tiles' edges and takes longer. Larger makes fewer tiles. auto: half of the machine's memory.",
        kind=float,
        unit="GB",
        bounds=(0.35, 1024.0),
        advanced=True,
    )


@dataclass(frozen=True)
class RawGroundParameters(GroundParameters):
    """Ground of raw surveys: extracted, or as the surveys have it."""

    ground: str = _parameter(
        "extract",
        "Ground points",
        "Which points are the ground. extract: the ground is extracted from all. class_2: those of class 2. as_is: "
        "all, whatever they are, as of clouds that hold the ground alone.",
        # QGIS stores the place of a choice: new ones go to the end.
        choices=("extract", "class_2", "as_is"),
    )

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        return tuple(sorted(super().specifications(), key=lambda s: s.name != "ground"))
