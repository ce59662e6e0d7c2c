"""Every parameter of SlopeWatch: name, default, unit, bounds and help, in one place.

The QGIS dialogs, the command line and the batch manifest are built from these dataclasses, so they cannot
disagree. Standard library only and Python 3.9's language, because QGIS's interpreter imports this module.

Defaults are chosen by measurement (see docs/figures.md); ``PROFILES["paper"]`` reproduces the published settings of
ground extraction, registration and gridding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

T = TypeVar("T", bound="ParameterSet")


AUTO = "auto"
"""The word for a number that the data decide, 0 in the parameter groups."""


class ParameterError(ValueError):
    """A parameter has a value that it cannot take; the message names it, its value and its bounds."""


@dataclass(frozen=True)
class Specification:
    """What a dialog or a command line needs to know about one parameter.

    ``kind`` is the Python type (bool, int, float or str); ``choices`` is empty unless the value is one of a list;
    ``minimum`` and ``maximum`` are inclusive; ``help`` says what the parameter does and what larger values change.
    ``automatic`` is the least number that stands for itself where 0, or the word auto, leaves the choice to the data;
    None where there is no such choice.
    """

    name: str
    kind: type
    default: Any
    label: str
    unit: str
    help: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    advanced: bool
    automatic: float | None = None

    @property
    def label_with_unit(self) -> str:
        label = self.label if self.automatic is None else f"{self.label}, 0 for {AUTO}"
        return f"{label} ({self.unit})" if self.unit else label

    @property
    def option(self) -> str:
        """Name on the command line, without dashes in front: ``cloth-resolution``."""
        return self.name.replace("_", "-")

    @property
    def qgis_name(self) -> str:
        """Name in a Processing algorithm: ``CLOTH_RESOLUTION``."""
        return self.name.upper()

    def check(self, value: Any) -> Any:
        """Return ``value`` as ``kind``.

        Raises:
            ParameterError: not of the kind, not finite, out of bounds or not among the choices.
        """
        try:
            if self.kind is bool:
                if not isinstance(value, bool):
                    raise ValueError
            elif self.kind is int:
                if isinstance(value, bool) or int(value) != float(value):
                    raise ValueError
                value = int(value)
            elif self.kind is float:
                if isinstance(value, bool):
                    raise ValueError
                value = 0.0 if self.automatic is not None and value == AUTO else float(value)
                if not math.isfinite(value):
                    raise ValueError
            elif not isinstance(value, str):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"{self.name} is {value!r}; give {self._domain()}") from None
        below = self.minimum is not None and value < self.minimum
        below = below or (self.automatic is not None and 0 < value < self.automatic)
        above = self.maximum is not None and value > self.maximum
        if below or above or (self.choices and value not in self.choices):
            raise ParameterError(f"{self.name} is {value!r}; give {self._domain()}")
        return value

    def _domain(self) -> str:
        if self.choices:
            return "one of " + ", ".join(self.choices)
        noun = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}[self.kind]
        unit = f" {self.unit}" if self.unit else ""
        if self.automatic is not None:
            return f"{noun} from {self.automatic:g} to {self.maximum:g}{unit}, or {AUTO}"
        if self.minimum is not None and self.maximum is not None:
            return f"{noun} from {self.minimum:g} to {self.maximum:g}{unit}"
        if self.minimum is not None:
            return f"{noun} of at least {self.minimum:g}{unit}"
        return noun + unit


def _parameter(
    default: Any,
    label: str,
    help: str,  # noqa: A002 - the word users know
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    advanced: bool = False,
    automatic: float | None = None,
) -> Any:
    return field(
        default=default,
        metadata={
            "label": label,
            "unit": unit,
            "help": help,
            "minimum": minimum,
            "maximum": maximum,
            "choices": choices,
            "advanced": advanced,
            "automatic": automatic,
        },
    )


def _other_default(group: type[ParameterSet], name: str, default: Any) -> Any:
    """The parameter ``name`` of another group with a default of its own."""
    return field(default=default, metadata=next(f.metadata for f in fields(group) if f.name == name))


@dataclass(frozen=True)
class ParameterSet:
    """Base of the parameter groups: checked on construction, built from names and values."""

    def __post_init__(self) -> None:
        for specification in self.specifications():
            value = specification.check(getattr(self, specification.name))
            object.__setattr__(self, specification.name, value)

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        return tuple(
            Specification(name=f.name, kind=type(f.default), default=f.default, **f.metadata) for f in fields(cls)
        )

    def named(self) -> dict[str, Any]:
        """The values by name; what is left to the data as the word for it."""
        values = {s.name: (s, getattr(self, s.name)) for s in self.specifications()}
        every = {f.name: getattr(self, f.name) for f in fields(self)}
        left = {name for name, (s, value) in values.items() if s.automatic is not None and value == 0}
        return {name: AUTO if name in left else value for name, value in every.items()}

    @classmethod
    def build(cls: type[T], values: Mapping[str, Any] | None = None, profile: str = "default") -> T:
        """The profile's values for this group and those it extends, overridden by those of ``values`` that are not None
        and belong to this group.

        Raises:
            ParameterError: an unknown profile, or a value out of bounds.
        """
        if profile not in PROFILES:
            raise ParameterError(f"profile is {profile!r}; give one of {', '.join(PROFILES)}")
        merged: dict[str, Any] = {}
        for group in reversed(cls.__mro__):
            merged.update(PROFILES[profile].get(group.__name__, {}))
        names = {f.name for f in fields(cls)}
        merged.update({k: v for k, v in (values or {}).items() if k in names and v is not None})
        return cls(**merged)


@dataclass(frozen=True)
class InputParameters(ParameterSet):
    """How the input clouds are to be read."""

    crs: str = _parameter(
        "",
        "Coordinate reference system",
        "Used instead of what the cloud declares, such as EPSG:32651. Empty: the cloud's own. Needed where a cloud "
        "declares none or a wrong one.",
    )
    height_unit: str = _parameter(
        "auto",
        "Unit of heights",
        "Unit of z. auto: the vertical unit of the reference system, else its horizontal unit.",
        choices=("auto", "metre", "foot", "us-survey-foot"),
        advanced=True,
    )


@dataclass(frozen=True)
class DateParameters(ParameterSet):
    """What is done where the days of surveys and their files disagree."""

    trust_dates: bool = _parameter(
        False,
        "Trust the days given",
        "Goes on where GPS times, names or creation days of the files say that the surveys are in reversed order. Off: "
        "they are refused, as swapped surveys turn raising into lowering.",
        advanced=True,
    )


@dataclass(frozen=True)
class SurfaceParameters(ParameterSet):
    """Which points are taken of clouds that are compared as they are."""

    ground: str = _parameter(
        "auto",
        "Ground points",
        "Which points are the ground. auto: all, and a raw survey with its plants is refused. class_2: those of class "
        "2. as_is: all, whatever they are, as for rock faces and structures that look like plants.",
        choices=("auto", "class_2", "as_is"),
    )


@dataclass(frozen=True)
class OutputParameters(ParameterSet):
    """What is done with results that an output folder holds already."""

    overwrite: bool = _parameter(
        False,
        "Overwrite earlier results",
        "Replaces the results in the output folder; what people entered in the tables of their zones goes over to the "
        "zones that continue. Off: a folder that holds results is refused.",
    )


@dataclass(frozen=True)
class GroundParameters(ParameterSet):
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
        minimum=0.02,
        maximum=20.0,
    )
    rigidness: int = _parameter(
        1,
        "Cloth rigidness",
        "1 for steep slopes, 2 for terraces, 3 for flat ground. Larger bends less and bridges relief.",
        minimum=1,
        maximum=3,
    )
    class_threshold: float = _parameter(
        0.06,
        "Ground threshold",
        "Points within this distance of bare ground's surface (of the cloth, without refinement) are ground. It widens "
        "by itself with the scatter of the ground, and to 0.1 m where returns are few. Larger keeps more low plants.",
        unit="m",
        minimum=0.005,
        maximum=5.0,
    )
    refine: bool = _parameter(
        True,
        "Refine the ground",
        "Follows the lowest layer of returns from seeds near the cloth, so that grass and shrubs are not taken for it "
        "and places that no return reached stay empty. Off: the cloth alone decides, as published.",
    )
    cloth_reach: float = _parameter(
        0.3,
        "Reach of the cloth",
        "The refinement takes its seeds from points within this distance of the cloth, and from what lies below them. "
        "Larger takes more seeds, also from plants where no pulse reached the ground.",
        unit="m",
        minimum=0.05,
        maximum=20.0,
        advanced=True,
    )
    last_returns: bool = _parameter(
        True,
        "Last returns only",
        "Only the last return of a pulse can be ground. Left out where the cloud's return numbers make no sense.",
        advanced=True,
    )
    time_step: float = _parameter(
        0.65,
        "Time step",
        "Step of the cloth's fall under gravity. Larger settles in fewer iterations and passes over fine relief.",
        minimum=0.05,
        maximum=2.0,
        advanced=True,
    )
    iterations: int = _parameter(
        500,
        "Iterations",
        "Upper limit of the cloth's steps; it stops earlier once it rests. Larger never harms but takes longer.",
        minimum=1,
        maximum=10000,
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
        "Points this far above or below all others, and five times as far beside them, stand apart. It widens by "
        "itself to three times the spacing of sparse clouds. Larger removes less.",
        unit="m",
        minimum=0.05,
        maximum=100.0,
        advanced=True,
    )
    denoise_group: int = _parameter(
        10,
        "Largest group of outliers",
        "Groups of at most so many points that stand apart are outliers. Larger removes more.",
        minimum=1,
        maximum=100000,
        advanced=True,
    )
    minimum_ground_ratio: float = _parameter(
        0.001,
        "Least plausible share of ground",
        "Below this share of the clipped points the extraction fails with an error. Larger is stricter.",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )


@dataclass(frozen=True)
class RegistrationParameters(ParameterSet):
    """Registration of a later epoch (moving) to the first (reference)."""

    method: str = _parameter(
        "robust",
        "Registration method",
        "robust: point-to-plane with weights that real change does not pull along. icp: point-to-point as "
        "published. none: the epochs are taken as registered.",
        choices=("robust", "icp", "none"),
    )
    maximum_offset: float = _parameter(
        1.0,
        "Largest expected offset",
        "Search distance at the start of the robust registration. Larger finds larger offsets and takes longer.",
        unit="m",
        minimum=0.01,
        maximum=50.0,
    )
    maximum_correspondence: float = _parameter(
        0.10,
        "Largest correspondence (icp)",
        "Pairs farther apart are ignored by the icp method. Larger reaches farther and lets more change in.",
        unit="m",
        minimum=0.001,
        maximum=50.0,
        advanced=True,
    )
    registration_iterations: int = _parameter(
        200,
        "Iterations of the registration",
        "Upper limit; it stops earlier once the motion or the RMSE no longer changes.",
        minimum=1,
        maximum=10000,
        advanced=True,
    )
    registration_voxel: float = _parameter(
        0.1,
        "Voxel of the registration",
        "Points are averaged in cubes of this size first. Larger is faster, smaller keeps more detail.",
        unit="m",
        minimum=0.01,
        maximum=10.0,
        advanced=True,
    )
    minimum_stable_share: float = _parameter(
        0.3,
        "Least share of stable ground",
        "Below this share of stable ground the run warns, and the level of detection widens unless that ground is "
        "clearly the largest part that agrees on one motion.",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )
    accept_unstable: bool = _parameter(
        False,
        "Accept a registration without stable ground",
        "Goes on where less than the least share of the surface agrees and no part of it is clearly the one that did "
        "not move, with an error as wide as the differences. Off: such surveys are refused.",
        advanced=True,
    )
    piecewise: str = _parameter(
        "never",
        "Correct bent surveys",
        "Heights are corrected where one rigid motion leaves stable ground bent over tens of metres, by strips that do "
        "not fit or a bowl. never: the run only tells. auto: where it fits. always: everywhere. Slow movements of that "
        "extent are taken off with it. Has no effect without the robust method.",
        choices=("never", "auto", "always"),
        advanced=True,
    )
    piece_size: float = _parameter(
        20.0,
        "Size of a piece",
        "Distance over which the correction of bent surveys may change. Smaller follows more and hides more movement.",
        unit="m",
        minimum=5.0,
        maximum=1000.0,
        advanced=True,
    )


@dataclass(frozen=True)
class GridChangeParameters(ParameterSet):
    """Gridding and differencing of registered ground clouds in cells of one size, as a series takes them."""

    cell: float = _parameter(
        0.0,
        "Cell size",
        "Side of a grid cell; where cells grow, of the smallest. Larger is less noisy and covers more, smaller shows "
        "finer change. auto: about as far as the points of the sparser survey are apart (0.1, 0.2, 0.5, 1, 2 or 5 m).",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        automatic=0.005,
    )
    cell_value: str = _parameter(
        "plane",
        "Height of a cell",
        "plane: the slope of the ground around a cell is taken from its points first, which removes the error of "
        "uneven sampling on steep ground. mean: mean height of the cell's points, as published.",
        choices=("mean", "plane"),
    )
    minimum_points: int = _parameter(
        1,
        "Least points in a cell",
        "A cell counts in an epoch with at least so many points. Larger is surer and covers less.",
        minimum=1,
        maximum=1000,
    )
    confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability with which unchanged ground stays below the level. Larger reports less and surer change.",
        minimum=0.5,
        maximum=0.9999,
    )
    threshold: str = _parameter(
        "probabilistic",
        "Threshold",
        "What counts as change. probabilistic: beyond the level of detection of the cell's own error. coherent: the "
        "same, surer or less sure by how many cells around changed alike. propagated: beyond the level of the errors "
        "that you state for both surveys. constant: beyond a level that you give.",
        choices=("probabilistic", "coherent", "propagated", "constant"),
    )
    constant_level: float = _parameter(
        0.10,
        "Constant level",
        "Level of detection of every cell with the constant threshold. Larger reports less. Has no effect on others.",
        unit="m",
        minimum=0.001,
        maximum=100.0,
        advanced=True,
    )
    error_from: float = _parameter(
        0.04,
        "Error of the earlier survey",
        "Standard error of a height, for the propagated threshold. Larger reports less. Has no effect on others.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    error_to: float = _parameter(
        0.04,
        "Error of the later survey",
        "Standard error of a height, for the propagated threshold. Larger reports less. Has no effect on others.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    direction: str = _parameter(
        "auto",
        "Direction of the change",
        "vertical: difference of heights. normal: distance square to the slope, for faces steeper than about 35 "
        "degrees, where a small horizontal shift looks like a large change of height. auto: normal where half of the "
        "compared ground is steeper than 50 degrees, else vertical.",
        choices=("vertical", "normal", "auto"),
    )
    calibrate: bool = _parameter(
        True,
        "Calibrate errors on stable ground",
        "Scales the errors, by slope, so that unchanged ground stays below its level of detection as often as the "
        "confidence says. Off: errors are what the points' scatter and the registration tell, as they are.",
        advanced=True,
    )
    registration_error: float = _parameter(
        -1.0,
        "Registration error",
        "Standard error of the registration in height that enters the level of detection. -1: as the registration "
        "measured it. Larger widens the level.",
        unit="m",
        minimum=-1.0,
        maximum=10.0,
        advanced=True,
    )
    memory_limit: float = _parameter(
        4.0,
        "Memory for the grid",
        "A grid that would need more is refused, with its size and a cell size that fits.",
        unit="GB",
        minimum=0.05,
        maximum=1024.0,
        advanced=True,
    )

    @property
    def grows(self) -> bool:
        """Whether cells grow with these settings."""
        return False


@dataclass(frozen=True)
class ChangeParameters(GridChangeParameters):
    """Gridding and differencing of two registered ground clouds."""

    adaptive: bool = _parameter(
        True,
        "Cells that grow",
        "Where points are few, as under plants, a cell doubles its side until its level of detection is low enough. "
        "More ground is compared, with less detail there; a cell has at least 4 points of each survey (3 where the "
        "change is four times its level), and planes through them are compared. Off, or with the mean as height of a "
        "cell: all cells have one size.",
    )
    target_level: float = _parameter(
        0.05,
        "Level at which a cell stops growing",
        "A growing cell is large enough once its level of detection is this low. Larger shows finer change, smaller "
        "finds weaker change. Has no effect on cells that do not grow.",
        unit="m",
        minimum=0.001,
        maximum=10.0,
        advanced=True,
    )
    largest_cell: float = _parameter(
        0.0,
        "Largest cell",
        "No cell grows beyond it, whatever its level of detection. Larger compares more of sparse ground and blurs "
        "its change more. auto: 1.6 m, or what comes next in steps of twice the cell; larger where the surveys are too "
        "sparse for most of such cells, and then only where smaller ones have too few points. Has no effect on cells "
        "that do not grow.",
        unit="m",
        minimum=0.0,
        maximum=200.0,
        advanced=True,
        automatic=0.01,
    )

    @property
    def grows(self) -> bool:
        return self.adaptive and not self.why_one_size

    @property
    def why_one_size(self) -> str:
        """Why cells cannot grow with these settings, in a sentence; empty where they can."""
        if self.cell_value != "plane":
            return "Cells have one size: their heights are means (cell_value), which is for cells of one size."
        if 0 < self.largest_cell < 2 * self.cell * (1 - 1e-9):
            return (
                f"Cells have one size: {self.cell:g} m leave no room to grow within a largest_cell of "
                f"{self.largest_cell:g} m."
            )
        return ""


@dataclass(frozen=True)
class ZoneParameters(ParameterSet):
    """Hazard zones: contiguous cells of significant change."""

    minimum_area: float = _parameter(
        0.5,
        "Least area of a zone",
        "Smaller groups of significant cells are not reported; small gaps without data within a group count. Larger "
        "reports fewer and surer zones.",
        unit="m²",
        minimum=0.0,
        maximum=1e6,
    )
    minimum_cells: int = _parameter(
        5,
        "Least cells in a zone",
        "Smaller groups of significant cells are not reported, whatever their area. A part of a grown cell counts as a "
        "part, a grown cell far beyond its level as up to half of this number. Larger is surer where cells are large: "
        "on 90 unchanged simulated slopes with cells that grow, groups of five or more came up by chance on one.",
        minimum=2,
        maximum=100000,
        advanced=True,
    )
    minimum_confidence: float = _parameter(
        0.95,
        "Least confidence of a zone",
        "Groups of significant cells that noise alone may make somewhere on the map are not reported. 0.95: on one "
        "unchanged map in twenty there would be one. Larger is surer and misses more. With less than 0.95, zones below "
        "that have the severity unsure; 0 reports all.",
        minimum=0.0,
        maximum=0.9999,
        advanced=True,
    )
    bridged_gap: float = _parameter(
        0.2,
        "Gap without data that does not divide a zone",
        "Parts that lie this close with nothing measured between them, as under vegetation, are one zone; the gap does "
        "not count in its area. A volume counts what lies this close to measured cells. Larger joins more. 0: only "
        "cells that touch.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    severity_moderate: float = _parameter(
        0.10,
        "Moderate from",
        "A zone whose change (95th percentile) reaches this is moderate, else low.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    severity_high: float = _parameter(
        0.30,
        "High from",
        "A zone whose change (95th percentile) reaches this is high.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )


@dataclass(frozen=True)
class HeatmapParameters(ParameterSet):
    """Heatmap over the top view."""

    top_view_pixel: float = _parameter(
        0.1,
        "Pixel of the top view",
        "Side of a pixel of the orthographic top view. Smaller is sharper where the cloud is dense enough.",
        unit="m",
        minimum=0.005,
        maximum=100.0,
    )
    opacity: float = _parameter(
        0.6,
        "Opacity of the heatmap",
        "0 shows the top view alone, 1 the change alone.",
        minimum=0.0,
        maximum=1.0,
    )
    colour_range: float = _parameter(
        0.0,
        "Colour range",
        "The legend runs from minus to plus this change. 0: from the data (98th percentile).",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )


@dataclass(frozen=True)
class ReportParameters(ParameterSet):
    """Profiles for the report."""

    zone_profiles: int = _parameter(
        3,
        "Profiles through zones",
        "A profile is taken down the slope through each of so many zones, the most severe first. Larger makes a longer "
        "report. 0: none.",
        minimum=0,
        maximum=50,
    )
    profile_field: str = _parameter(
        "",
        "Field with the profiles' names",
        "Field of the profiles' lines that names them. Empty: name, label, profile or id, where there is one.",
        advanced=True,
    )


@dataclass(frozen=True)
class DistanceParameters(ParameterSet):
    """Distances of two clouds along the surface's normal: M3C2 (Lague et al. 2013).

    It has a command of its own, so that ``confidence`` and ``registration_error`` are named as in ``ChangeParameters``.
    """

    normal_scale: float = _parameter(
        0.0,
        "Normal scale",
        "Diameter of the ball whose points give the normal. Larger is steadier and smooths relief. 0: 25 times the "
        "roughness, from the reference.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    projection_scale: float = _parameter(
        0.0,
        "Projection scale",
        "Diameter of the cylinder that gathers the points of both surveys. Larger is surer and blurs. 0: so that it "
        "holds about 25 points of the sparser survey.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    half_length: float = _parameter(
        0.0,
        "Half length of the cylinder",
        "The cylinder reaches so far to both sides of the surface. Change beyond it is not seen; too long a cylinder "
        "meets other surfaces. 0: twice as far as the surveys are apart.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    core_spacing: float = _parameter(
        0.0,
        "Spacing of the core points",
        "One point of the reference in each cube of this size is measured. Smaller shows more and takes longer. 0: "
        "about half the projection scale. Has no effect where core points are given.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    distance_cell: float = _parameter(
        0.0,
        "Cell of the rasters",
        "Side of a cell, which holds the mean of its core points. Smaller leaves gaps. 0: the spacing of the core "
        "points.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
        advanced=True,
    )
    normals: str = _parameter(
        "fitted",
        "Normals",
        "Direction of measuring. fitted: square to the surface of the reference. given: the dimensions NormalX, "
        "NormalY and NormalZ of the core points. vertical: straight up, as a difference of heights.",
        choices=("fitted", "given", "vertical"),
        advanced=True,
    )
    orientation: str = _parameter(
        "0,0,1",
        "Side of the normals",
        "Fitted normals point to the side of this direction (x,y,z), which counts as raising. 0,0,1: upwards, right "
        "for all but overhanging faces.",
        advanced=True,
    )
    minimum_cylinder_points: int = _parameter(
        5,
        "Least points in a cylinder",
        "With fewer points of either survey no level of detection is told and nothing is significant. Larger is surer.",
        minimum=2,
        maximum=100000,
        advanced=True,
    )
    confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability with which unchanged ground stays below the level. Larger reports less and surer change.",
        minimum=0.5,
        maximum=0.9999,
    )
    registration_error: float = _parameter(
        -1.0,
        "Registration error",
        "Standard error of the registration, which enters the level of detection. -1: as the transform tells, else 0. "
        "Larger widens the level.",
        unit="m",
        minimum=-1.0,
        maximum=10.0,
    )
    calibrate: bool = _parameter(
        True,
        "Calibrate errors on stable ground",
        "Sums the errors in squares and scales them, by slope, so that unchanged ground stays below its level of "
        "detection as often as the confidence says. Off: the level as Lague et al. (2013) published it, which adds the "
        "registration error to that of the points and is wider or narrower than it says.",
    )


@dataclass(frozen=True)
class SeriesParameters(ParameterSet):
    """More than two surveys of one slope."""

    ground_ready: bool = _parameter(
        False,
        "Clouds are ground already",
        "Takes all points of the clouds as ground (as Extract ground wrote them), inside the region of interest. Off: "
        "the ground of each raw survey is extracted first.",
    )
    rasters_each_survey: bool = _parameter(
        True,
        "Rasters of every survey",
        "Also writes the change and its level of detection for each survey against the first and against the one "
        "before. Off: velocity, confirmation and zones only.",
    )


@dataclass(frozen=True)
class ScreeningParameters(ParameterSet):
    """Screening of one survey: which ground looks raised or lowered against the slope around it."""

    screening_method: str = _parameter(
        "network",
        "Screening method",
        "network: the trained network labels every point. residual: a threshold on the height over the slope's trend, "
        "without learning.",
        choices=("network", "residual"),
    )
    ground: str = _parameter(
        "auto",
        "Ground points",
        "Which points are the ground. auto: all but those of the noise classes, and a cloud that is no bare ground is "
        "refused. extract: the ground is extracted first. class_2: those of class 2. as_is: all, whatever they are.",
        choices=("auto", "extract", "class_2", "as_is"),
    )
    weights: str = _parameter(
        "",
        "Weights",
        "The network's weights, a .safetensors file with its .json beside it. Empty: the ones shipped with SlopeWatch.",
        advanced=True,
    )
    rotations: int = _parameter(
        1,
        "Rotations",
        "The network looks at each place mirrored and turned in so many ways and averages. Larger takes that "
        "much longer; in trials it gave no measurable gain.",
        minimum=1,
        maximum=16,
        advanced=True,
    )
    residual_threshold: float = _parameter(
        0.08,
        "Threshold of the residual method",
        "Ground this far above or below the trend is labelled by the residual method. Larger labels less.",
        unit="m",
        minimum=0.005,
        maximum=10.0,
        advanced=True,
    )
    minimum_probability: float = _parameter(
        0.0,
        "Least probability of a hazard",
        "Points and cells below it are background. Larger labels less and surer. 0: the most probable class.",
        minimum=0.0,
        maximum=0.999,
    )
    minimum_hazard_area: float = _parameter(
        0.5,
        "Least area of a hazard zone",
        "Smaller zones are left out (area on the map). Larger reports fewer and surer zones.",
        unit="m²",
        minimum=0.0,
        maximum=1e6,
    )
    probability_cell: float = _parameter(
        0.25,
        "Cell of the probability raster",
        "Side of a cell of the raster and of the zones' outlines. Larger is smoother and bridges sparse points.",
        unit="m",
        minimum=0.02,
        maximum=10.0,
    )
    write_classification: bool = _parameter(
        False,
        "Write the classification, too",
        "Also gives labelled points the LAS class 64 (uplift) or 65 (subsidence), for programs that do not read extra "
        "dimensions.",
        advanced=True,
    )
    minimum_dip: float = _parameter(
        10.0,
        "Flattest slope",
        "A cloud whose dominant plane is flatter is refused. Larger refuses more.",
        unit="degrees",
        minimum=0.0,
        maximum=90.0,
        advanced=True,
    )
    maximum_dip: float = _parameter(
        80.0,
        "Steepest slope",
        "A cloud whose dominant plane is steeper is refused. Larger refuses less.",
        unit="degrees",
        minimum=0.0,
        maximum=90.0,
        advanced=True,
    )
    any_density: bool = _parameter(
        False,
        "Screen at any density",
        "Only warns where the cloud is sparser or denser than the clouds that the network was trained on. Its labels "
        "are not to be relied on then.",
        advanced=True,
    )
    device: str = _parameter(
        "cpu",
        "Device",
        "What the network runs on. cpu gives the same labels everywhere. auto: a graphics card where there is one.",
        choices=("cpu", "gpu", "auto"),
        advanced=True,
    )
    threads: int = _parameter(
        0,
        "Threads",
        "Windows that are worked on at the same time. Larger is faster and takes more memory. 0: one a processor core, "
        "at most 8.",
        minimum=0,
        maximum=256,
        advanced=True,
    )


@dataclass(frozen=True)
class LastEpochParameters(ScreeningParameters):
    """Screening of the last epoch of an inspection, whose ground has been extracted already."""

    ground: str = _parameter("as_is", "Ground points", "The ground that was extracted.", choices=("as_is",))
    screen_last_epoch: bool = _parameter(
        True,
        "Screen the last survey",
        "Also labels the ground of the last survey by its shape, and says which of the zones found so the change "
        "confirms. Left out with a warning where the network or the slope does not allow it.",
    )

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        every = [s for s in super().specifications() if s.name != "ground"]
        return tuple(sorted(every, key=lambda s: s.name != "screen_last_epoch"))


@dataclass(frozen=True)
class SurveyParameters(ParameterSet):
    """Simulated pair of surveys of one cut slope, with known change and a known rigid offset."""

    seed: int = _parameter(1, "Seed", "The same seed gives the same surveys.", minimum=0, maximum=2**31 - 1)
    points: int = _parameter(
        1_000_000,
        "Points an epoch",
        "Approximate number of points of each survey; the pulse rate is thinned to reach it.",
        minimum=1000,
        maximum=200_000_000,
    )
    length: float = _parameter(
        60.0, "Length of the slope", "Extent along the road.", unit="m", minimum=5.0, maximum=2000.0
    )
    height: float = _parameter(25.0, "Height of the slope", "From toe to crest.", unit="m", minimum=2.0, maximum=500.0)
    angle: float = _parameter(
        39.0,
        "Angle of the slope",
        "Angle of the cut face to the horizontal.",
        unit="degrees",
        minimum=5.0,
        maximum=75.0,
    )
    benches: int = _parameter(0, "Benches", "Number of berms in the cut face.", minimum=0, maximum=10)
    vegetation: float = _parameter(
        0.7,
        "Vegetation cover",
        "Share of the ground seen from above that lies under shrubs and trees. Larger leaves fewer ground points.",
        minimum=0.0,
        maximum=0.98,
    )
    range_noise: float = _parameter(
        0.02, "Range noise", "Standard deviation of a measured range.", unit="m", minimum=0.0, maximum=0.5
    )
    offset: float = _parameter(
        0.2,
        "Rigid offset",
        "Displacement of the second epoch's coordinates, which registration must undo.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    amplitude: float = _parameter(
        0.3, "Change", "Largest height change that is put into the second epoch.", unit="m", minimum=0.0, maximum=10.0
    )
    grass: float = _parameter(
        0.0, "Closed grass", "Share of the slope under closed grass, without gaps.", minimum=0.0, maximum=1.0
    )
    grass_height: float = _parameter(
        0.7,
        "Grass height",
        "Mean height of the longest stems of closed grass; half of its returns lie below about a third of it.",
        unit="m",
        minimum=0.1,
        maximum=1.5,
        advanced=True,
    )
    mown: str = _parameter(
        "never",
        "Mown in",
        "Surveys in which the closed grass is mown: stubble of 3 to 8 cm with cuttings on the ground.",
        choices=("never", "first", "later", "both"),
    )
    ferns: float = _parameter(
        0.0,
        "Ferns and low shrubs",
        "Share of the slope under ferns and low shrubs that close, 0.4 to 1.5 m high; few returns are of the ground.",
        minimum=0.0,
        maximum=1.0,
    )
    forest: float = _parameter(
        0.0,
        "Native forest",
        "Share of the slope under dense native forest with ferns beneath: one return in 60 is of the ground.",
        minimum=0.0,
        maximum=1.0,
    )
    layout: str = _parameter(
        "patches",
        "Place of grass, ferns and forest",
        "patches: in patches of some metres. left: from the left end of the slope, seen from the road (ferns: from the "
        "right).",
        choices=("patches", "left"),
        advanced=True,
    )
    litter: float = _parameter(
        0.0,
        "Litter",
        "Mean thickness of dead leaves on the ground; hides the ground partly.",
        unit="m",
        minimum=0.0,
        maximum=0.1,
        advanced=True,
    )
    multipath: float = _parameter(
        0.0,
        "Returns below the ground",
        "Share of the returns that echoed on the way and lie 0.1 to 6 m below the ground, each alone.",
        minimum=0.0,
        maximum=0.05,
        advanced=True,
    )
    stray: float = _parameter(
        0.0,
        "Stray returns",
        "Share of the returns that lie anywhere along their beam, up to 15 m before the ground and 3 m behind it.",
        minimum=0.0,
        maximum=0.05,
        advanced=True,
    )


@dataclass(frozen=True)
class CreepParameters(SurveyParameters):
    """Simulated series of surveys of one cut slope with zones that creep; ``amplitude`` has no part in it."""

    points: int = _other_default(SurveyParameters, "points", 150_000)
    length: float = _other_default(SurveyParameters, "length", 30.0)
    height: float = _other_default(SurveyParameters, "height", 12.0)
    vegetation: float = _other_default(SurveyParameters, "vegetation", 0.3)
    offset: float = _other_default(SurveyParameters, "offset", 0.05)
    surveys: int = _parameter(6, "Surveys", "Number of surveys, the first included.", minimum=2, maximum=100)
    interval: int = _parameter(
        30, "Days between surveys", "From each survey to the next.", unit="days", minimum=1, maximum=3650
    )
    velocities: str = _parameter(
        "-10, 5, -2",
        "Velocities",
        "Vertical velocities in the middle of the zones, separated by commas: a zone for each, side by side along the "
        "slope; negative ones lower. Towards its edge a zone moves less.",
        unit="mm/day",
    )
    onset: float = _parameter(
        15.0,
        "Onset",
        "Days after the first survey at which the motion begins.",
        unit="days",
        minimum=0.0,
        maximum=36500.0,
    )
    ground_only: bool = _parameter(
        False,
        "Ground points only",
        "Writes only the echoes of the ground, as a perfect ground filter would leave them (for Clouds hold ground "
        "points of a series).",
    )

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        return tuple(s for s in super().specifications() if s.name != "amplitude")


@dataclass(frozen=True)
class ScenesParameters(ParameterSet):
    """Simulated slope scenes of one epoch, whose every point has a known class."""

    kind: str = _parameter(
        "published",
        "Kind of scene",
        "published: a quarter of the points each bulge and sink, as in the published simulation. realistic: hazards as "
        "rare as on slopes, a fifth of the scenes without any. shifted: other landforms, hazards, densities and noise.",
        choices=("published", "realistic", "shifted"),
    )
    count: int = _parameter(3, "Number of scenes", "More give more ground to learn from.", minimum=1, maximum=10_000)
    seed: int = _parameter(
        1000,
        "Seed",
        "Seed of the first scene; each next one has the next seed. The benchmark sets have seeds below 1000, scenes "
        "that models are trained on have seeds from 1,000,000 on.",
        minimum=0,
        maximum=2**31 - 1,
    )
    area: float = _parameter(
        0.0,
        "Area of a scene",
        "Measured on the slope. 0: drawn from the kind's range, 2,000 to 11,000 m².",
        unit="m²",
        minimum=0.0,
        maximum=100_000.0,
    )
    density: float = _parameter(
        0.0,
        "Density",
        "Points on a square metre of the slope. 0: drawn from the kind's range.",
        unit="points/m²",
        minimum=0.0,
        maximum=2000.0,
    )
    benchmark: bool = _parameter(
        False,
        "Scenes of the benchmark set",
        "Writes the first scenes of the kind's benchmark set instead, whose areas and shares are balanced over the "
        "whole set; seed, area and density have no effect then.",
        advanced=True,
    )
    picture: bool = _parameter(
        True, "Picture", "Also draws the first twelve scenes with their classes and hard negatives as scenes.png."
    )


@dataclass(frozen=True)
class FineTuneParameters(ParameterSet):
    """Training a screening model on one's own labelled clouds."""

    start: str = _parameter(
        "shipped",
        "Start from",
        "shipped: the weights that come with SlopeWatch. none: from nothing, which needs many more files and steps. "
        "Or a .safetensors file.",
    )
    dimension: str = _parameter(
        "slopewatch_class",
        "Dimension with the labels",
        "Name of the clouds' dimension that holds the classes, such as slopewatch_class, truth_class or "
        "Classification. Has no effect where polygons give the labels.",
    )
    classes: str = _parameter(
        "",
        "Classes of the values",
        "What the values mean, such as 2:background,20:uplift,21:subsidence,*:unknown, where * is every other value "
        "and unknown is left out of training. Empty: 0 background, 1 uplift, 2 subsidence, 255 unknown.",
    )
    class_field: str = _parameter(
        "class",
        "Field with the class",
        "Field of the polygons that holds their class: background, uplift, subsidence, unknown, or a value that the "
        "classes explain.",
    )
    outside: str = _parameter(
        "background",
        "Outside of the polygons",
        "What points in no polygon are. unknown: they are left out of training, for clouds that were labelled in part.",
        choices=("background", "unknown"),
    )
    steps: int = _parameter(
        600,
        "Steps",
        "Steps of each training; there is one for every fold and one on all files. More fit better and take longer.",
        minimum=1,
        maximum=1_000_000,
    )
    minutes: float = _parameter(
        0.0,
        "Minutes",
        "Chooses the steps so that all takes about this long on this machine. 0: the steps as given.",
        unit="minutes",
        minimum=0.0,
        maximum=100_000.0,
    )
    folds: int = _parameter(
        5,
        "Folds",
        "The files are split into so many parts, each scored by a model that never saw it. With fewer files each one "
        "is a part. More cost more trainings.",
        minimum=2,
        maximum=100,
    )
    learning_rate: float = _parameter(
        0.0,
        "Learning rate",
        "Largest step size. Larger adapts faster and forgets more. 0: 0.002 from weights, 0.01 from nothing.",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )
    batch: int = _parameter(
        2,
        "Windows in a step",
        "Larger is steadier and takes more memory and time.",
        minimum=1,
        maximum=256,
        advanced=True,
    )
    network: str = _parameter(
        "standard",
        "Network",
        "Used where training starts from nothing. standard: the size of the shipped one. smoke: a tiny one that learns "
        "within a minute, to try things out.",
        choices=("standard", "smoke"),
        advanced=True,
    )
    seed: int = _parameter(
        0,
        "Seed",
        "The same seed gives the same folds and, on one machine's processor, the same weights.",
        minimum=0,
        maximum=2**31 - 1,
        advanced=True,
    )
    device: str = _parameter(
        "cpu",
        "Device",
        "What the training runs on. auto: a graphics card where there is one.",
        choices=("cpu", "gpu", "auto"),
        advanced=True,
    )
    threads: int = _parameter(
        0, "Threads", "Processor cores to use. 0: all of them.", minimum=0, maximum=1024, advanced=True
    )


PROFILES: dict[str, dict[str, dict[str, Any]]] = {
    "default": {},
    "paper": {
        "GroundParameters": {
            "slope_aligned": False,
            "cloth_resolution": 0.1,
            "rigidness": 1,
            "time_step": 0.5,
            "class_threshold": 0.05,
            "refine": False,
            "last_returns": False,
            "slope_smoothing": False,
        },
        "RegistrationParameters": {
            "method": "icp",
            "maximum_correspondence": 0.10,
            "registration_iterations": 200,
        },
        "GridChangeParameters": {
            "cell": 0.1,
            "cell_value": "mean",
            "minimum_points": 1,
            "threshold": "probabilistic",
            "direction": "vertical",
            "calibrate": False,
        },
        "ChangeParameters": {"adaptive": False},
    },
}
