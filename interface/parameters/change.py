"""Parameters of the comparison of two surveys on a grid."""

from __future__ import annotations

from dataclasses import dataclass

from .memory import memory_for
from .specification import AUTO, ParameterSet, _parameter, given


@dataclass(frozen=True)
class GridChangeParameters(ParameterSet, record_name="change"):
    """Gridding and differencing of registered ground clouds in cells of one size."""

    cell: float | str = _parameter(
        AUTO,
        "Cell size",
        "Side of a grid cell; where cells grow, of the smallest. Larger is less noisy and covers more, smaller shows "
        "finer change. auto: about the point spacing of the sparser survey (0.1, 0.2, 0.5, 1, 2 or 5 m).",
        kind=float,
        unit="m",
        bounds=(0.005, 100.0),
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
        "Minimum points in a cell",
        "A cell of an epoch with fewer points has no height. Larger is more reliable and covers less.",
        bounds=(1, 1000),
    )
    confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability that unchanged ground stays below the level. Larger reports less change, and more reliably.",
        bounds=(0.5, 0.9999),
    )
    threshold: str = _parameter(
        "probabilistic",
        "Threshold",
        "What counts as change. probabilistic: beyond the level of detection of the cell's own error. coherent: the "
        "same, where the probability also depends on how many cells around changed alike. propagated: beyond the level "
        "of the errors that you state for both surveys. constant: beyond a level that you give.",
        choices=("probabilistic", "coherent", "propagated", "constant"),
    )
    constant_level: float = _parameter(
        0.10,
        "Constant level",
        "Level of detection of every cell with the constant threshold. Larger reports less. No effect with other "
        "thresholds.",
        unit="m",
        bounds=(0.001, 100.0),
        advanced=True,
    )
    error_from: float = _parameter(
        0.04,
        "Error of the earlier survey",
        "Standard error of a height, for the propagated threshold. Larger reports less. No effect with other "
        "thresholds.",
        unit="m",
        bounds=(0.0, 100.0),
        advanced=True,
    )
    error_to: float = _parameter(
        0.04,
        "Error of the later survey",
        "Standard error of a height, for the propagated threshold. Larger reports less. No effect with other "
        "thresholds.",
        unit="m",
        bounds=(0.0, 100.0),
        advanced=True,
    )
    direction: str = _parameter(
        "auto",
        "Direction of the change",
        "vertical: difference of heights. normal: distance perpendicular to the slope, for faces steeper than about 35 "
        "degrees, where a small horizontal shift looks like a large change of height. auto: normal where half of the "
        "compared ground is steeper than 50 degrees, else vertical.",
        choices=("vertical", "normal", "auto"),
    )
    calibrate: bool = _parameter(
        True,
        "Calibrate errors on stable ground",
        "Scales the errors, by slope, so that unchanged ground stays below its level of detection as often as the "
        "confidence says. Off: the errors of the points' scatter and of the registration are used as they are.",
        advanced=True,
    )
    registration_error: float | str = _parameter(
        AUTO,
        "Registration error",
        "Standard error of the registration in height, which enters the level of detection. Larger widens the level. "
        "auto: as the registration measured it.",
        kind=float,
        unit="m",
        bounds=(0.0, 10.0),
        advanced=True,
    )
    memory_limit: float | str = memory_for(
        "Memory for the grid",
        "A grid that needs more is refused, before any work where the cell is given; the message gives its size and a "
        "cell size that fits. Larger allows smaller cells on a larger slope. auto: half of the machine's memory.",
    )

    @property
    def cell_side(self) -> float:
        """The cell in metres, which must have been given or chosen."""
        return float(self.cell)

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
        "cell: all cells have the same size.",
    )
    target_level: float = _parameter(
        0.05,
        "Level at which a cell stops growing",
        "A growing cell is large enough once its level of detection is this low. Larger shows finer change, smaller "
        "finds weaker change. Has no effect on cells that do not grow.",
        unit="m",
        bounds=(0.001, 10.0),
        advanced=True,
    )
    largest_cell: float | str = _parameter(
        AUTO,
        "Largest cell",
        "No cell grows beyond it, whatever its level of detection. Larger compares more of sparse ground and blurs "
        "its change more. auto: 1.6 m, or the next size that doubling the cell gives; larger where the surveys are too "
        "sparse for most of such cells, and then only where smaller ones have too few points. Has no effect on cells "
        "that do not grow.",
        kind=float,
        unit="m",
        bounds=(0.01, 200.0),
        advanced=True,
    )

    @property
    def grows(self) -> bool:
        return self.adaptive and not self.why_one_size

    @property
    def why_one_size(self) -> str:
        """Why cells cannot grow with these settings, in a sentence; empty where they can."""
        if self.cell_value != "plane":
            return "Cells have one size: their heights are means (cell_value), which is for cells of one size."
        cell, largest = given(self.cell), given(self.largest_cell)
        if cell and largest and largest < 2 * cell * (1 - 1e-9):
            return f"Cells have one size: {cell:g} m leave no room to grow within a largest_cell of {largest:g} m."
        return ""
