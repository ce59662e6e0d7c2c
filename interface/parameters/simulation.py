"""Parameters of simulated surveys and scenes."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, Specification, _other_default, _parameter


@dataclass(frozen=True)
class SurveyParameters(ParameterSet, record_name="survey", title="Simulation"):
    """Simulated pair of surveys of one cut slope, with known change and a known rigid offset."""

    seed: int = _parameter(1, "Seed", "The same seed gives the same surveys.", bounds=(0, 2**31 - 1))
    points: int = _parameter(
        1_000_000,
        "Points per epoch",
        "Approximate number of points of each survey; the pulse rate is thinned to reach it.",
        bounds=(1000, 200_000_000),
    )
    length: float = _parameter(60.0, "Length of the slope", "Extent along the road.", unit="m", bounds=(5.0, 2000.0))
    height: float = _parameter(25.0, "Height of the slope", "From toe to crest.", unit="m", bounds=(2.0, 500.0))
    angle: float = _parameter(
        39.0,
        "Angle of the slope",
        "Angle of the cut face to the horizontal.",
        unit="degrees",
        bounds=(5.0, 75.0),
    )
    benches: int = _parameter(0, "Benches", "Number of berms in the cut face.", bounds=(0, 10))
    vegetation: float = _parameter(
        0.7,
        "Vegetation cover",
        "Share of the ground seen from above that lies under shrubs and trees. Larger leaves fewer ground points.",
        bounds=(0.0, 0.98),
    )
    range_noise: float = _parameter(
        0.02, "Range noise", "Standard deviation of a measured range.", unit="m", bounds=(0.0, 0.5)
    )
    offset: float = _parameter(
        0.2,
        "Rigid offset",
        "Displacement of the second epoch's coordinates, which registration must undo.",
        unit="m",
        bounds=(0.0, 10.0),
    )
    amplitude: float = _parameter(
        0.3, "Change", "Largest height change that is put into the second epoch.", unit="m", bounds=(0.0, 10.0)
    )
    motion: str = _parameter(
        "none",
        "Motion along the surface",
        "Ground that moves along its face and carries its roughness. translation: a patch as one. rotation: a disc "
        "turns in the face. creep: fastest in the middle, fading out softly. slump: a body turns on a slip surface, "
        "with scarp and toe. all: one of each, side by side. Takes the place of the height changes.",
        choices=("none", "translation", "rotation", "creep", "slump", "all"),
    )
    motion_amount: float = _parameter(
        0.1,
        "Way along the surface",
        "How far the middle of the moving ground moves until the second epoch; of a rotation, the rim of its core.",
        unit="m",
        bounds=(0.0, 2.0),
    )
    erosion: float = _parameter(
        0.0,
        "Erosion of micro relief",
        "Wavelength of which half the relief is worn away and replaced from each survey to the next; of shorter "
        "relief more, of longer less. The roughness stays what it was. 0: none.",
        unit="m",
        bounds=(0.0, 5.0),
        advanced=True,
    )
    grass_growth: float = _parameter(
        0.0,
        "Growth of short grass",
        "How much higher the short grass is in the mean after the first survey, in patches of about 2 m; it hides "
        "part of the ground.",
        unit="m",
        bounds=(0.0, 0.2),
        advanced=True,
    )
    grass: float = _parameter(
        0.0, "Closed grass", "Share of the slope under closed grass, without gaps.", bounds=(0.0, 1.0)
    )
    grass_height: float = _parameter(
        0.7,
        "Grass height",
        "Mean height of the longest stems of closed grass; half of its returns lie below about a third of it.",
        unit="m",
        bounds=(0.1, 1.5),
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
        "Share of the slope under closed ferns and low shrubs, 0.4 to 1.5 m high; few returns are from the ground.",
        bounds=(0.0, 1.0),
    )
    forest: float = _parameter(
        0.0,
        "Native forest",
        "Share of the slope under dense native forest with ferns below: one return in 60 is from the ground.",
        bounds=(0.0, 1.0),
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
        "Mean thickness of dead leaves on the ground, which partly hide it.",
        unit="m",
        bounds=(0.0, 0.1),
        advanced=True,
    )
    multipath: float = _parameter(
        0.0,
        "Returns below the ground",
        "Share of the returns that come from multiple reflections and lie isolated, 0.1 to 6 m below the ground.",
        bounds=(0.0, 0.05),
        advanced=True,
    )
    stray: float = _parameter(
        0.0,
        "Stray returns",
        "Share of the returns that lie anywhere along their beam, up to 15 m before the ground and 3 m behind it.",
        bounds=(0.0, 0.05),
        advanced=True,
    )


@dataclass(frozen=True)
class CreepParameters(SurveyParameters, record_name="creep", title="Simulation"):
    """Simulated series of surveys of one cut slope with zones that creep.

    Without ``amplitude`` and ``motion_amount``.
    """

    points: int = _other_default(SurveyParameters, "points", 150_000)
    length: float = _other_default(SurveyParameters, "length", 30.0)
    height: float = _other_default(SurveyParameters, "height", 12.0)
    vegetation: float = _other_default(SurveyParameters, "vegetation", 0.3)
    offset: float = _other_default(SurveyParameters, "offset", 0.05)
    surveys: int = _parameter(6, "Surveys", "Number of surveys, the first included.", bounds=(2, 100))
    interval: int = _parameter(
        30, "Interval of the surveys", "From each survey to the next.", unit="days", bounds=(1, 3650)
    )
    velocities: str = _parameter(
        "-10, 5, -2",
        "Velocities",
        "Vertical velocities in the middle of the zones, separated by commas: one zone for each, side by side along "
        "the slope; negative is lowering. Towards its edge a zone moves less. With a motion along the surface: how "
        "fast the zones move down the slope, without regard to the sign.",
        unit="mm/day",
    )
    onset: float = _parameter(
        15.0,
        "Onset",
        "Days after the first survey at which the motion begins.",
        unit="days",
        bounds=(0.0, 36500.0),
    )
    ground_only: bool = _parameter(
        False,
        "Ground points only",
        "Writes only the echoes of the ground, as a perfect ground filter would leave them (for as_is under "
        "Ground points of a series).",
    )

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        return tuple(s for s in super().specifications() if s.name not in ("amplitude", "motion_amount"))


@dataclass(frozen=True)
class ScenesParameters(ParameterSet, record_name="scenes", title="Simulation"):
    """Simulated slope scenes of one epoch, whose every point has a known class."""

    kind: str = _parameter(
        "published",
        "Kind of scene",
        "published: a quarter of the points each is uplift and subsidence, as in the published simulation. realistic: "
        "hazards as rare as on real slopes, none in a fifth of the scenes. shifted: other landforms, hazards, "
        "densities and noise.",
        choices=("published", "realistic", "shifted"),
    )
    count: int = _parameter(3, "Number of scenes", "More give more ground to learn from.", bounds=(1, 10_000))
    seed: int = _parameter(
        1000,
        "Seed",
        "Seed of the first scene; each further one has the next seed. The benchmark sets have seeds below 1000, scenes "
        "that models are trained on have seeds from 1,000,000 on.",
        bounds=(0, 2**31 - 1),
    )
    area: float | str = _parameter(
        AUTO,
        "Area of a scene",
        "Measured on the slope. auto: drawn from the kind's range, 2,000 to 11,000 m².",
        kind=float,
        unit="m²",
        bounds=(1.0, 100_000.0),
    )
    density: float | str = _parameter(
        AUTO,
        "Density",
        "Points per square metre of the slope. auto: drawn from the kind's range.",
        kind=float,
        unit="points/m²",
        bounds=(0.1, 2000.0),
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
