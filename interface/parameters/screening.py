"""Parameters of screening a single survey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .specification import AUTO, ParameterSet, Specification, _parameter


@dataclass(frozen=True)
class ScreeningParameters(ParameterSet, record_name="screening"):
    """Screening of one survey: which ground looks raised or lowered against the slope around it."""

    screening_method: str = _parameter(
        AUTO,
        "Screening method",
        "auto: what the weights given are for, relief without any. relief: a network trained on real and simulated "
        "ground looks at a raster of the slope's relief, and zones that stand out of it are shown at the accepted "
        "false zones. network: a network on points, trained on simulated slopes, whose zones are shown at the accepted "
        "false zones, too. filter: bumps and hollows of 2 to 8 m that stand out of the roughness around them, at the "
        "accepted false zones, without learning. "
        "residual: a threshold on the height over the slope's trend, without learning.",
        # QGIS stores the place of a choice: new ones go to the end.
        choices=("network", "filter", "residual", "relief", AUTO),
    )
    ground: str = _parameter(
        "auto",
        "Ground points",
        "Which points are the ground. auto: all but those of the noise classes, and a cloud that is not bare ground is "
        "refused. extract: the ground is extracted first. class_2: those of class 2. as_is: all, whatever they are.",
        choices=("auto", "extract", "class_2", "as_is"),
    )
    weights: str = _parameter(
        "",
        "Weights",
        "Weights of relief or network, a .safetensors file with its .json next to it, which says of which. Empty: "
        "those shipped with SlopeWatch.",
        advanced=True,
    )
    rotations: int = _parameter(
        1,
        "Rotations",
        "The method network sees each place mirrored and rotated in this many ways, and the results are averaged. "
        "Larger takes proportionally longer; in trials it gave no measurable gain.",
        bounds=(1, 16),
        advanced=True,
    )
    residual_threshold: float = _parameter(
        0.08,
        "Threshold of the residual method",
        "Ground this far above or below the trend is labelled by the residual method. Larger labels less.",
        unit="m",
        bounds=(0.005, 10.0),
        advanced=True,
    )
    minimum_probability: float = _parameter(
        0.0,
        "Minimum probability of a hazard",
        "Points and cells below it are background with residual; with the other methods a zone that nowhere reaches "
        "it is left out. Larger labels less, and more reliably. 0 takes nothing away.",
        bounds=(0.0, 0.999),
    )
    minimum_hazard_area: float = _parameter(
        0.5,
        "Minimum area of a hazard zone",
        "Smaller zones are left out (area on the map). Larger reports fewer and more reliable zones.",
        unit="m²",
        bounds=(0.0, 1e6),
    )
    probability_cell: float = _parameter(
        0.25,
        "Cell of the probability raster",
        "Side of a cell of the raster and of the zones' outlines. Larger is smoother and bridges sparse points.",
        unit="m",
        bounds=(0.02, 10.0),
    )
    false_zones: float = _parameter(
        1.0,
        "Accepted false zones per 1,000 m²",
        "How many false zones on 1,000 m² of the slope are accepted. The methods relief, network and "
        "filter set their threshold by it, and the map of the smallest hazard refers to it. Larger finds lower "
        "hazards, and shows more zones that are none.",
        bounds=(0.1, 10.0),
    )
    write_classification: bool = _parameter(
        False,
        "Also write the classification",
        "Also gives labelled points the LAS class 64 (uplift) or 65 (subsidence), for programs that do not read extra "
        "dimensions.",
        advanced=True,
    )
    minimum_dip: float = _parameter(
        10.0,
        "Flattest slope",
        "A cloud whose dominant plane is flatter is refused. Larger refuses more.",
        unit="degrees",
        bounds=(0.0, 90.0),
        advanced=True,
    )
    maximum_dip: float = _parameter(
        80.0,
        "Steepest slope",
        "A cloud whose dominant plane is steeper is refused. Larger refuses less.",
        unit="degrees",
        bounds=(0.0, 90.0),
        advanced=True,
    )
    any_density: bool = _parameter(
        False,
        "Screen at any density",
        "Only warns where the cloud is sparser or denser than the clouds that the method was made for. Its labels "
        "are not reliable then.",
        advanced=True,
    )
    any_relief: bool = _parameter(
        False,
        "Show zones on any relief",
        "Shows zones even where the ground is so rough or so sparse that on most of it a hazard of 1 m could not be "
        "found. They say little then.",
        advanced=True,
    )
    self_test: bool = _parameter(
        False,
        "Self-test",
        "Also puts hazards of known size into the ground, screens it in the same way, and reports how many are found. "
        "Takes three times as long.",
    )
    device: str = _parameter(
        "cpu",
        "Device",
        "What the network runs on. cpu gives the same labels everywhere. auto: a graphics card where there is one.",
        choices=("cpu", "gpu", "auto"),
        advanced=True,
    )
    threads: int | str = _parameter(
        AUTO,
        "Threads",
        "Windows or tiles that are processed at the same time. Larger is faster and takes more memory. auto: one per "
        "processor core, at most 8.",
        kind=int,
        bounds=(1, 256),
        advanced=True,
    )


@dataclass(frozen=True)
class LastEpochParameters(ScreeningParameters):
    """Screening of the last epoch of an inspection, whose ground has been extracted already."""

    ground: str = _parameter("as_is", "Ground points", "The ground that was extracted.", choices=("as_is",))
    screen_last_epoch: bool = _parameter(
        True,
        "Screen the last survey",
        "Also labels the ground of the last survey by its shape, and says which of these zones the change "
        "confirms. Left out with a warning where the network or the slope does not allow it.",
    )

    @classmethod
    def build(
        cls: type[LastEpochParameters], values: Mapping[str, Any] | None = None, profile: str = "default"
    ) -> LastEpochParameters:
        """As of all sets; the name ``ground`` is that of another set of the same command."""
        return super().build({k: v for k, v in (values or {}).items() if k != "ground"}, profile)

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        every = [s for s in super().specifications() if s.name != "ground"]
        return tuple(sorted(every, key=lambda s: s.name != "screen_last_epoch"))
