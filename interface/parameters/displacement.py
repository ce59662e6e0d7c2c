"""Parameters of motion along the surface."""

from __future__ import annotations

from dataclasses import dataclass

from .memory import memory_for_points
from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class DisplacementParameters(ParameterSet, record_name="displacement"):
    """Vectors of how far ground has moved along its surface, found by its relief."""

    window: float = _parameter(
        5.0,
        "Window",
        "Width of the windows in which one motion is sought. Larger has smaller errors, about by its width, and blurs "
        "the edges of what moves.",
        unit="m",
        bounds=(1.0, 100.0),
    )
    wide_window: float = _parameter(
        8.0,
        "Wide window",
        "Width of the windows with which zones are found. A vector counts all windows that touch the wide one at its "
        "place. Larger finds slower motion of larger areas. Not wider than the window above: not used.",
        unit="m",
        bounds=(1.0, 100.0),
    )
    spacing: float = _parameter(
        2.0,
        "Spacing of the vectors",
        "Distance of the windows' middles, and the cell of the rasters. Smaller shows more detail and takes longer; "
        "windows overlap.",
        unit="m",
        bounds=(0.25, 100.0),
    )
    largest_motion: float = _parameter(
        1.0,
        "Largest motion",
        "How far along the surface motion is looked for. Larger takes longer and mistakes like relief for each other.",
        unit="m",
        bounds=(0.05, 10.0),
    )
    vector_confidence: float = _parameter(
        0.99,
        "Confidence of a vector",
        "Probability that a window of still ground shows no vector. Larger shows fewer vectors, and more reliable "
        "ones.",
        bounds=(0.5, 0.9999),
    )
    slide_area: float = _parameter(
        12.0,
        "Minimum area of a moving zone",
        "Zones of coherent motion that are smaller are left out. Larger reports fewer zones.",
        unit="m²",
        bounds=(0.0, 100000.0),
    )
    surface_error: float | str = _parameter(
        AUTO,
        "Registration error along the surface",
        "Standard error of the registration in each horizontal direction, which enters the error of each vector. "
        "Larger shows fewer vectors. auto: as the transform states it, else 0.",
        kind=float,
        unit="m",
        bounds=(0.0, 10.0),
    )
    subtract: bool = _parameter(
        False,
        "Take off the common motion",
        "Takes the motion that most of the ground has in common off all vectors, as an error of the registration. "
        "Only where most of the ground is known to be still: a slope that creeps as a whole would seem to stand.",
    )


@dataclass(frozen=True)
class MotionMemoryParameters(ParameterSet, record_name="motion_memory", title="Memory"):
    """Memory of motion along the surface as a command of its own."""

    memory_limit: float | str = memory_for_points()


@dataclass(frozen=True)
class DisplacementStepParameters(ParameterSet, record_name="displacement_step", title="Displacement"):
    """Whether motion along the surface is measured, too."""

    displacement: bool = _parameter(
        True,
        "Motion along the surface",
        "Also measures how far the ground moved along its surface, which heights hardly show, where its relief allows "
        "it. Off: heights only, which is faster.",
    )
