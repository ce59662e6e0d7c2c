"""How a run ends: three to eleven sentences on what was found, where it lies, and what to look at.

They are made of the run's figures, all of which stay in its record. A command without an entry here ends with where its
files lie; one may also say its own sentences in ``RunResult.conclusion``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ..engine.core.json_values import plain
from ..engine.core.run_result import RunResult
from .conclusions_of_models import statistics, trend
from .conclusions_of_tools import OF_TOOLS
from .figures_in_words import Figures, counted, measured, number, percent, plural, sentence, zones_found

MOST = 12
"""Sentences at most."""

# Outputs that people open first, in that order; two of them are named.
_FIRST = (
    "report", "page", "series_zones", "corridor", "zones", "screened_zones", "m3c2_significant",
    "displacement_vectors", "labelled", "significant_change", "weights", "aligned", "points", "ground",
    "picture", "plan", "roi", "located", "report/report.html", "report/corridor.html", "layers.gpkg", "handover",
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
    only_slid = bool(count) and f.get("slid_zones") == count
    if only_slid:
        found = (
            f"{zones_found(count, 'significant change')}, {measured(f, 'zone_area_m2', 'm²')} in all: what moved there "
            "slid along the surface, and no material was lost or gained."
        )
    elif count:
        lost, gained = (
            measured(f, f"vol_{kind}_m3", "m³", error=f"vol_{kind}_err_m3") or "0 m³" for kind in ("loss", "gain")
        )
        found = f"{zones_found(count, 'significant change')}: {lost} lost and {gained} gained over their footprints."
        covered = [measured(f, f"{name}_area_m2", "m²") for name in ("zone", "footprint")]
        net = [measured(f, f"{name}_net_m3", "m³") for name in ("zone", "footprint")]
        more = "The zones themselves cover {} with a net volume of {}, their footprints {} with {}."
        found = f"{found} {sentence(more, covered[0], net[0], covered[1], net[1])}".rstrip()
    return [
        found,
        _slides(f),
        sentence(
            "The largest lowering in a zone is {}, the largest raising {}.",
            measured(f, "largest_sink_m", "m", sign=False), measured(f, "largest_rise_m", "m"),
        ) if count and not only_slid else "",
        _seen(f),
        sentence(
            "Change below the level of detection, {} in the median, cannot be distinguished from none.",
            measured(f, "lod_median_m", "m"),
        ),
        _slid(f),
        _objects(f),
        _moved(f),
        _biased(f),
        _confirmed(f),
    ]  # fmt: skip


_UNSEEN = {
    "not_in_first": "{} of the slope was compared; {} has no ground in the first survey.",
    "not_in_later": "{} of the slope was compared; {} has no ground in the later survey.",
    "not_in_both": "{} of the slope was compared; {} has no ground in both surveys.",
    "too_few": "{} of the slope was compared; {} has too few ground points.",
    "excluded": "{} of the slope was compared; {} was excluded by hand.",
}
"""By the class of ``interface.seen`` that holds most of what was not compared."""


def _seen(f: Figures) -> str:
    shares = {name: f[f"{name}_share"] for name in _UNSEEN if f.get(f"{name}_share")}
    if not shares:
        return sentence("{} of the slope was compared.", percent(f, "compared_share"))
    most = max(shares, key=lambda name: shares[name])
    return sentence(_UNSEEN[most], percent(f, "compared_share"), percent(f, f"{most}_share"))


def _dem_change(f: Figures) -> list[str]:
    size = measured(f, "bias_m", "m", error="bias_error_m", sign=False)
    if (f.get("bias_m") or 0.0) < 0:
        bias = sentence(
            "The later model lay {} below the earlier one on stable ground; that is taken off and is no change.", size
        )
    else:
        bias = sentence(
            "The later model lay {} above the earlier one on stable ground; that is taken off and is no change.", size
        )
    if f.get("zone_count") is None:
        return [bias, trend(f), *statistics(f)]
    return [bias, trend(f), *_change(f)]


def _slid(f: Figures) -> str:
    """What zones did, where that was asked for."""
    if f.get("slid_zones") is None:
        return ""
    sank, bulged, lost, gained = (number(f.get(f"{name}_zones", 0)) for name in ("sank", "bulged", "lost", "gained"))
    rest = f"{sank} sank, {bulged} bulged, {lost} lost and {gained} gained material"
    count = f["slid_zones"]
    if not count:
        return f"No zone was found to have slid along the surface; {rest}."
    most = measured(f, "largest_slide_m", "m", error="largest_slide_err_m", sign=False)
    return f"Of the zones, {number(count)} slid along the surface, by up to {most}; {rest}."


def _objects(f: Figures) -> str:
    """What appeared or vanished above the ground, if all returns were compared."""
    new, gone = f.get("objects_appeared") or 0, f.get("objects_vanished") or 0
    if not new + gone:
        return ""
    return f"Boulders, walls, vehicles and heaps above the ground: {number(new)} appeared, {number(gone)} vanished."


def _confirmed(f: Figures) -> str:
    count = f.get("screened_zone_count")
    if count is None:
        return ""
    if not count:
        return "By its shape alone, no zone of the last survey looks raised or lowered."
    return (
        f"By its shape, {number(count)} {plural(count, 'zone')} of the last survey look raised or lowered; the "
        f"change confirms {number(f.get('confirmed_zones', 0))} of them."
    )


def _moved(f: Figures) -> str:
    if f.get("registration_method") in (None, "none"):
        return ""
    shift = [measured(f, f"registration_d{axis}_m", "m") for axis in "xyz"]
    error = measured(f, "registration_error_m", "m")
    return sentence(
        "The later survey was moved by {} to the east, {} to the north and {} upwards to fit the earlier one"
        + (f", with a standard error of {error} in height." if error else "."),
        *shift,
    )


def _biased(f: Figures) -> str:
    """Names a vertical bias between two campaigns where it clearly exceeds its error."""
    bias, error = f.get("registration_vertical_bias_m"), f.get("registration_error_m")
    if bias is None or error is None or abs(bias) < max(_MIN_BIAS_M, _BIAS_ERRORS * error):
        return ""
    size = measured(f, "registration_vertical_bias_m", "m", sign=False)
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
        sentence("{} of the surface agrees on that motion.", percent(f, "registration_stable_share")),
    ]


def _slides(f: Figures) -> str:
    """What an inspection says of motion along the surface."""
    count, share = f.get("moving_zone_count"), percent(f, "motion_measured_share")
    if count is None or not share:
        return ""
    if count:
        return _moving_zones(f)
    if f.get("significant_vectors"):
        return " ".join(["No zone that moves along the surface was found.", _single_vectors(f)])
    return (
        "No motion along the surface above the level of detection was found where it can be seen, on "
        f"{share} of the ground."
    )


def _single_vectors(f: Figures) -> str:
    """Whether vectors outside of zones are as many as chance makes."""
    single, most = f.get("significant_vectors"), f.get("chance_vectors_most")
    if not single:
        return ""
    if most is None:
        return f"Single vectors that are significant: {single:.0f}; chance makes some of them."
    expected = f"{f['chance_vectors']:.1f}"
    if single <= most:
        return (
            f"Single vectors that are significant: {single:.0f}, no more than chance gives ({expected} expected, up to "
            f"{most:.0f} on 95 % of still slopes)."
        )
    return (
        f"Single vectors that are significant: {single:.0f}, more than chance gives ({expected} expected, up to "
        f"{most:.0f} on 95 % of still slopes); look where they lie."
    )


def _moving_zones(f: Figures) -> str:
    return (
        f"{zones_found(f['moving_zone_count'], 'motion along the surface')}, {measured(f, 'moving_area_m2', 'm²')} in "
        f"all; the largest motion of one is {measured(f, 'fastest_zone_m', 'm')}."
    )


def _displacement(f: Figures) -> list[str]:
    return [
        _moving_zones(f) if f.get("moving_zone_count") else "No zone that moves along the surface was found.",
        "" if f.get("moving_zone_count") else _single_vectors(f),
        sentence(
            "On {} of the ground motion along the surface can be measured; where nothing else is said, one below {} "
            "in the median cannot be told from none.",
            percent(f, "measured_share"), measured(f, "smallest_motion_median_m", "m"),
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
            f"{zones_found(count, 'ground that looks raised or lowered')}, "
            f"{measured(f, f'{prefix}zone_area_m2', 'm²')} in all: {number(f.get(f'{prefix}uplift_zones', 0))} raised, "
            f"{number(f.get(f'{prefix}subsidence_zones', 0))} lowered."
        )
    smallest = {width: of.get("median") for width, of in dict(f.get(f"{prefix}smallest_hazard_m") or {}).items()}
    return [
        found,
        sentence(
            "A hazard 3 m wide must be about {} high to be found on this ground, one 8 m wide about {}.",
            *(measured(smallest, width, "m") for width in ("3", "8")),
        ),
        sentence(
            "{} points of a slope that dips by {} were looked at.",
            counted(f, f"{prefix}ground_points"), measured(f, f"{prefix}dip", "degrees"),
        ),
    ]  # fmt: skip


def _ground(f: Figures) -> list[str]:
    return [
        sentence(
            "{} of the {} points in the region are ground ({}).",
            counted(f, "ground_points"), counted(f, "roi_points"), percent(f, "ground_ratio"),
        ),
        sentence(
            "The region is {} with {} points a square metre.",
            measured(f, "roi_area", "m²"), measured(f, "roi_density", ""),
        ),
        sentence("Plants cover {} of it.", percent(f, "vegetation_cover")),
        sentence("{} of it was reached by no pulse.", percent(f, "without_ground_share")),
    ]  # fmt: skip


def _m3c2(f: Figures) -> list[str]:
    return [
        sentence(
            "{} of {} core points have a distance with a level of detection; {} moved beyond it.",
            *(counted(f, f"{name}_points") for name in ("measured", "core", "significant")),
        ),
        sentence(
            "The largest significant lowering is {}, the largest raising {}.",
            measured(f, "largest_lowering_m", "m", sign=False), measured(f, "largest_raising_m", "m"),
        ),
        sentence("The level of detection is {} in the median.", measured(f, "lod_median_m", "m")),
        sentence(
            "The normal is of points within {}, the cylinder {} wide and {} long to both sides.",
            *(measured(f, name, "m") for name in ("normal_scale_m", "projection_scale_m", "half_length_m")),
        ),
    ]  # fmt: skip


def _series(f: Figures) -> list[str]:
    count = f.get("zone_count", 0)
    found = "No zone moved beyond its level of detection."
    if count:
        fastest = measured(f, "fastest_rate_mm_day", "mm/day")
        found = (
            f"{number(count)} {plural(count, 'zone')} moved, {number(f.get('confirmed_zone_count', 0))} of them "
            "confirmed by two comparisons or more" + (f"; the fastest by {fastest}." if fastest else ".")
        )
    return [
        sentence("{} surveys over {} days were compared.", counted(f, "epoch_count"), counted(f, "days")),
        found,
        sentence(
            "{} of them moved along the surface, the fastest by {}.",
            counted(f, "moving_zone_count") if f.get("moving_zone_count") else "",
            measured(f, "fastest_motion_mm_day", "mm/day"),
        ),
        (
            f"The highest alert level is {number(f.get('highest_alert', 0))}; "
            f"zones with a level above 0: {number(f.get('alerted_zone_count', 0))}."
        ),
        sentence("Between two surveys a rate below {} stays unseen.", measured(f, "detectable_rate_mm_day", "mm/day")),
    ]


def _batch(f: Figures) -> list[str]:
    failed = f.get("slopes_failed", 0)
    return [
        sentence(
            "{} of {} slopes have results; {} were computed by this run.",
            *(counted(f, name) for name in ("slopes_done", "slopes", "slopes_computed")),
        ),
        f"{number(failed)} {plural(failed, 'slope')} failed; the table of slopes says why." if failed else "",
        sentence("They hold {} zones and {} open alerts.", counted(f, "zones"), counted(f, "open_alerts")),
    ]


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
    "report": _report,
    **OF_TOOLS,
}


def _places(outputs: Mapping[str, Path]) -> list[str]:
    paths = [Path(path).absolute() for path in outputs.values()]
    # the folder of the record, as a file that was wanted elsewhere must not make it the root of the disk
    folder = Path(outputs.get("run", paths[0])).absolute().parent
    known = [Path(outputs[key]) for key in _FIRST if key in outputs][:_NAMED]
    first = list(dict.fromkeys(_from(folder, path) for path in (known or paths[:1])))
    count = sum(folder in path.parents for path in set(paths))
    return [
        f"{number(count)} {plural(count, 'file')} {'was' if count == 1 else 'were'} written to {folder}.",
        f"Look first at {' and '.join(first)}.",
    ]


def _from(folder: Path, path: Path) -> str:
    """A file as people find it from the folder; its name where it lies elsewhere."""
    path = path.absolute()
    return path.relative_to(folder).as_posix() if folder in path.parents else path.name


def _of_warnings(result: RunResult) -> str:
    count = len(set(result.warnings))
    if not count:
        return "There were no warnings."
    where = ", which the run record keeps" if "run" in result.outputs else ""
    were = "was" if count == 1 else "were"
    return f"{number(count)} {plural(count, 'warning')} {were} given{where}; read them first."
