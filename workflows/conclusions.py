"""How a run ends: three to eight sentences on what was found, where it lies, and what to look at.

They are made of the run's figures, all of which stay in its record. A command without an entry here ends with where its
files lie; one may also say its own sentences in ``RunResult.conclusion``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..engine.core.json_values import plain
from ..engine.core.run_result import RunResult

Figures = Mapping[str, Any]
MOST = 8
"""Sentences at most."""

# Outputs that people open first, in that order; two of them are named.
_FIRST = (
    "report", "page", "series_zones", "corridor", "zones", "screened_zones", "m3c2_significant",
    "displacement_vectors", "labelled", "significant_change", "weights", "aligned", "points", "ground",
    "picture", "roi",
)  # fmt: skip
_NAMED = 2
_MIN_BIAS_M, _BIAS_ERRORS = 0.02, 3.0
"""Least vertical bias of a survey that is named: in metres, and in standard errors of the registration."""


def conclusion(command: str, result: RunResult) -> list[str]:
    """Plain sentences for people, of which the last say where the files are; none for a run that writes no file.

    Args:
        command: as on the command line, such as ``inspect`` or ``simulate survey``.
    """
    if not result.outputs:
        return list(result.conclusion)
    figures = plain(result.figures)
    found = list(result.conclusion) or [s for s in _FOUND.get(command, _nothing_more)(figures) if s]
    ends = _places(result.outputs)
    return [*found[: MOST - len(ends) - 1], *ends, _of_warnings(result)]


def _change(f: Figures) -> list[str]:
    count = f.get("zone_count")
    if count is None:
        return _screened(f, "screened_")
    found = "No zone of change above the level of detection was found."
    if count:
        lost, gained = (
            _measure(f, f"vol_{kind}_m3", "m³", error=f"vol_{kind}_err_m3") or "0 m³" for kind in ("loss", "gain")
        )
        found = (
            f"{_zones(count, 'significant change')}, {_measure(f, 'zone_area_m2', 'm²')} in all: {lost} lost and "
            f"{gained} gained."
        )
    return [
        found,
        _sentence("The largest lowering in a zone is {}, the largest raising {}.", _measure(
            f, "largest_sink_m", "m", sign=False), _measure(f, "largest_rise_m", "m")) if count else "",
        _sentence(
            "{} of the ground that the surveys reached was compared; change below the level of detection, {} in the "
            "median, cannot be distinguished from none.",
            _percent(f, "compared_share"), _measure(f, "lod_median_m", "m"),
        ),
        _moved(f),
        _biased(f),
        _confirmed(f),
    ]  # fmt: skip


def _dem_change(f: Figures) -> list[str]:
    bias = _sentence(
        "The later model lay {} above the earlier one on stable ground; that is taken off and is no change.",
        _measure(f, "bias_m", "m", error="bias_error_m"),
    )
    return [bias, *_change(f)]


def _confirmed(f: Figures) -> str:
    count = f.get("screened_zone_count")
    if count is None:
        return ""
    if not count:
        return "By its shape alone, no zone of the last survey looks raised or lowered."
    return (
        f"By its shape, {_number(count)} {_plural(count, 'zone')} of the last survey look raised or lowered; the "
        f"change confirms {_number(f.get('confirmed_zones', 0))} of them."
    )


def _moved(f: Figures) -> str:
    if f.get("registration_method") in (None, "none"):
        return ""
    shift = [_measure(f, f"registration_d{axis}_m", "m") for axis in "xyz"]
    error = _measure(f, "registration_error_m", "m")
    return _sentence(
        "The later survey was moved by {} to the east, {} to the north and {} upwards to fit the earlier one"
        + (f", with a standard error of {error} in height." if error else "."),
        *shift,
    )


def _biased(f: Figures) -> str:
    """Names a vertical bias between two campaigns where it clearly exceeds its error."""
    bias, error = f.get("registration_vertical_bias_m"), f.get("registration_error_m")
    if bias is None or error is None or abs(bias) < max(_MIN_BIAS_M, _BIAS_ERRORS * error):
        return ""
    size = _measure(f, "registration_vertical_bias_m", "m", sign=False)
    if bias > 0:
        return (
            f"On stable ground the later survey lay {size} higher than the earlier one: a vertical bias between the "
            "campaigns, which the registration took off, and no change."
        )
    return (
        f"On stable ground the later survey lay {size} lower than the earlier one: a vertical bias between the "
        "campaigns, which the registration took off, and no change."
    )


def _register(f: Figures) -> list[str]:
    return [
        _moved(f),
        _biased(f),
        _sentence("{} of the surface agrees on that motion.", _percent(f, "registration_stable_share")),
    ]


def _displacement(f: Figures) -> list[str]:
    count = f.get("moving_zone_count")
    found = "No zone that moves along the surface was found."
    if count:
        found = (
            f"{_zones(count, 'motion along the surface')}, {_measure(f, 'moving_area_m2', 'm²')} in all; the largest "
            f"motion of one is {_measure(f, 'fastest_zone_m', 'm')}."
        )
    return [
        found,
        _sentence(
            "On {} of the ground motion along the surface can be measured; where nothing else is said, one below {} "
            "in the median cannot be told from none.",
            _percent(f, "measured_share"), _measure(f, "smallest_motion_median_m", "m"),
        ),
        "Elsewhere nothing is known of motion along the surface; displacement.tif names the reason.",
    ]  # fmt: skip


def _screened(f: Figures, prefix: str = "") -> list[str]:
    count = f.get(f"{prefix}zone_count")
    if count is None:
        return []
    found = "No zone looks raised or lowered against the slope around it."
    if count:
        found = (
            f"{_zones(count, 'ground that looks raised or lowered')}, {_measure(f, f'{prefix}zone_area_m2', 'm²')} in "
            f"all: {_number(f.get(f'{prefix}uplift_zones', 0))} raised, "
            f"{_number(f.get(f'{prefix}subsidence_zones', 0))} lowered."
        )
    smallest = {width: of.get("median") for width, of in dict(f.get(f"{prefix}smallest_hazard_m") or {}).items()}
    return [
        found,
        _sentence(
            "A hazard 3 m wide must be about {} high to be found on this ground, one 8 m wide about {}.",
            *(_measure(smallest, width, "m") for width in ("3", "8")),
        ),
        _sentence(
            "{} points of a slope that dips by {} were looked at.",
            _count(f, f"{prefix}ground_points"), _measure(f, f"{prefix}dip", "degrees"),
        ),
    ]  # fmt: skip


def _ground(f: Figures) -> list[str]:
    return [
        _sentence(
            "{} of the {} points in the region are ground ({}).",
            _count(f, "ground_points"), _count(f, "roi_points"), _percent(f, "ground_ratio"),
        ),
        _sentence(
            "The region is {} with {} points a square metre.",
            _measure(f, "roi_area", "m²"), _measure(f, "roi_density", ""),
        ),
        _sentence("Plants cover {} of it.", _percent(f, "vegetation_cover")),
        _sentence("{} of it was reached by no pulse.", _percent(f, "without_ground_share")),
    ]  # fmt: skip


def _m3c2(f: Figures) -> list[str]:
    return [
        _sentence(
            "{} of {} core points have a distance with a level of detection; {} moved beyond it.",
            *(_count(f, f"{name}_points") for name in ("measured", "core", "significant")),
        ),
        _sentence(
            "The largest significant lowering is {}, the largest raising {}.",
            _measure(f, "largest_lowering_m", "m", sign=False), _measure(f, "largest_raising_m", "m"),
        ),
        _sentence("The level of detection is {} in the median.", _measure(f, "lod_median_m", "m")),
        _sentence(
            "The normal is of points within {}, the cylinder {} wide and {} long to both sides.",
            *(_measure(f, name, "m") for name in ("normal_scale_m", "projection_scale_m", "half_length_m")),
        ),
    ]  # fmt: skip


def _series(f: Figures) -> list[str]:
    count = f.get("zone_count", 0)
    found = "No zone moved beyond its level of detection."
    if count:
        fastest = _measure(f, "fastest_rate_mm_day", "mm/day")
        found = (
            f"{_number(count)} {_plural(count, 'zone')} moved, {_number(f.get('confirmed_zone_count', 0))} of them "
            "confirmed by two comparisons or more" + (f"; the fastest by {fastest}." if fastest else ".")
        )
    return [
        _sentence("{} surveys over {} days were compared.", _count(f, "epoch_count"), _count(f, "days")),
        found,
        (
            f"The highest alert level is {_number(f.get('highest_alert', 0))}; "
            f"{_number(f.get('alerted_zone_count', 0))} zones have one above 0."
        ),
        _sentence("Between two surveys a rate below {} stays unseen.", _measure(f, "detectable_rate_mm_day", "mm/day")),
    ]


def _batch(f: Figures) -> list[str]:
    failed = f.get("slopes_failed", 0)
    return [
        _sentence(
            "{} of {} slopes have results; {} were computed by this run.",
            *(_count(f, name) for name in ("slopes_done", "slopes", "slopes_computed")),
        ),
        f"{_number(failed)} {_plural(failed, 'slope')} failed; the table of slopes says why." if failed else "",
        _sentence("They hold {} zones and {} open alerts.", _count(f, "zones"), _count(f, "open_alerts")),
    ]


def _train(f: Figures) -> list[str]:
    return [
        _sentence("The model learned from {} labelled points.", _count(f, "labelled_points")),
        _sentence(
            "Of hazards that it was not trained on it finds {}, the weights that it started from {}.",
            _percent(f, "hazard_recall"), _percent(f, "start_hazard_recall"),
        ),
        _sentence(
            "On 1,000 m² of such ground it shows {} false zones, those weights {}.",
            _measure(f, "false_zones_per_1000_m2", ""), _measure(f, "start_false_zones_per_1000_m2", ""),
        ),
        _sentence("{} of the points that it was not trained on get their class.", _percent(f, "overall_accuracy")),
    ]  # fmt: skip


def _survey(f: Figures) -> list[str]:
    return [
        _sentence(
            "Two surveys of {} and {} points were simulated.", _count(f, "points_reference"), _count(f, "points_cloud")
        ),
        _sentence(
            "The later one holds {} changes: {} lowered and {} raised.",
            _count(f, "changes"), _measure(f, "volume_lowered_m3", "m³"), _measure(f, "volume_raised_m3", "m³"),
        ),
    ]  # fmt: skip


def _simulated_series(f: Figures) -> list[str]:
    return [
        _sentence(
            "{} surveys over {} days were simulated, {} points in all.",
            *(_count(f, name) for name in ("surveys", "days", "points")),
        ),
        _sentence("{} zones creep in them.", _count(f, "zones")),
    ]


def _scenes(f: Figures) -> list[str]:
    return [
        _sentence(
            "{} scenes with {} points and {} hazards were simulated.",
            *(_count(f, name) for name in ("scenes", "points", "hazards")),
        ),
        _sentence(
            "{} of the points are raised and {} lowered.",
            _percent(f, "share_uplift"), _percent(f, "share_subsidence"),
        ),
    ]  # fmt: skip


def _top_view(f: Figures) -> list[str]:
    ground = {"class_2": "those of class 2", "estimate": "those near a quick estimate, as there is no class 2"}
    shown = {"rgb": "the cloud's colours", "intensity": "its intensity", "height": "its relief"}
    return [
        _sentence("{} points became rasters with cells of {}.", _count(f, "points"), _measure(f, "cell_m", "m")),
        _sentence("The picture shows {}.", shown.get(str(f.get("picture")), "")),
        _sentence("There are {} in the median.", _measure(f, "density", "returns/m²")),
        _sentence("Ground returns are {}.", ground.get(str(f.get("ground")), "")),
    ]


def _region(f: Figures) -> list[str]:
    return [
        _sentence(
            "The proposed region has {}, {} of the cloud's area with {} of its points; look at it before it is used.",
            _measure(f, "area_m2", "m²"), _percent(f, "area_share"), _percent(f, "points_share"),
        )
    ]  # fmt: skip


def _tasks(f: Figures) -> list[str]:
    return [
        _sentence(
            "{} pictures with {} regions are ready for Label Studio.", _count(f, "pictures"), _count(f, "regions")
        )
    ]


def _labels(f: Figures) -> list[str]:
    return [
        _sentence(
            "{} regions of {} tasks became {} polygons, {} in all.",
            *(_count(f, name) for name in ("regions", "tasks", "polygons")), _measure(f, "area_m2", "m²"),
        )
    ]  # fmt: skip


def _report(_: Figures) -> list[str]:
    return ["The report was written again."]


def _nothing_more(_: Figures) -> list[str]:
    return ["The run has ended well, and its outputs were checked."]


_FOUND: dict[str, Callable[[Figures], list[str]]] = {
    "inspect": _change,
    "change": _change,
    "demchange": _dem_change,
    "register": _register,
    "screen": _screened,
    "ground": _ground,
    "m3c2": _m3c2,
    "displacement": _displacement,
    "series": _series,
    "batch": _batch,
    "train": _train,
    "report": _report,
    "topview": _top_view,
    "suggestroi": _region,
    "exportlabelstudio": _tasks,
    "importlabelstudio": _labels,
    "simulate survey": _survey,
    "simulate series": _simulated_series,
    "simulate scenes": _scenes,
}


def _places(outputs: Mapping[str, Path]) -> list[str]:
    paths = [Path(path).absolute() for path in outputs.values()]
    # the folder of the record, as a file that was wanted elsewhere must not make it the root of the disk
    folder = Path(outputs.get("run", paths[0])).absolute().parent
    known = [Path(outputs[key]) for key in _FIRST if key in outputs][:_NAMED]
    first = list(dict.fromkeys(path.name for path in (known or paths[:1])))
    count = sum(folder in path.parents for path in set(paths))
    return [
        f"{_number(count)} {_plural(count, 'file')} {'was' if count == 1 else 'were'} written to {folder}.",
        f"Look first at {' and '.join(first)}.",
    ]


def _of_warnings(result: RunResult) -> str:
    count = len(set(result.warnings))
    if not count:
        return "There were no warnings."
    where = ", which the run record keeps" if "run" in result.outputs else ""
    were = "was" if count == 1 else "were"
    return f"{_number(count)} {_plural(count, 'warning')} {were} given{where}; read them first."


def _sentence(text: str, *parts: str) -> str:
    """The sentence with its parts, empty where one is not known."""
    return text.format(*parts) if all(parts) else ""


def _zones(count: int, what: str) -> str:
    return f"{_number(count)} {_plural(count, 'zone')} of {what} {'was' if count == 1 else 'were'} found"


def _known(figures: Figures, name: str) -> float | None:
    value = figures.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return value


def _number(value: float) -> str:
    """Three figures, whole numbers in full with commas."""
    if float(value).is_integer() or abs(value) >= 1000:
        return f"{round(value):,}"
    return f"{value:.3g}"


def _count(figures: Figures, name: str) -> str:
    value = _known(figures, name)
    return "" if value is None else _number(value)


def _measure(figures: Figures, name: str, unit: str, *, error: str = "", sign: bool = True) -> str:
    """A figure with its unit and, where it is known, its standard error; empty where it is not known."""
    value = _known(figures, name)
    if value is None:
        return ""
    spread = _known(figures, error) if error else None
    value = value if sign else abs(value)
    # metres to the millimetre, which is finer than anything measured
    shown = f"{value:.3f}" if unit == "m" and 0.0005 <= abs(value) < 1000 else _number(value)
    if spread is not None:
        shown = f"{shown} ± {_number(float(f'{spread:.2g}'))}"
    return f"{shown} {unit}".rstrip()


def _percent(figures: Figures, name: str) -> str:
    value = _known(figures, name)
    return "" if value is None else f"{_number(float(f'{100 * value:.2g}'))} %"


def _plural(count: float, noun: str) -> str:
    return noun if count == 1 else f"{noun}s"
