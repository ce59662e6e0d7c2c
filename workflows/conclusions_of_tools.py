"""How a run ends that measures no change: clouds looked at or simulated, regions, flights, places on a road, models.

Sentences as those of ``conclusions``.
"""

from __future__ import annotations

from collections.abc import Callable

from .figures_in_words import Figures, counted, measured, percent, sentence


def _train(f: Figures) -> list[str]:
    return [
        sentence("The model learned from {} labelled points.", counted(f, "labelled_points")),
        sentence(
            "Of hazards that it was not trained on it finds {}, the weights that it started from {}.",
            percent(f, "hazard_recall"), percent(f, "start_hazard_recall"),
        ),
        sentence(
            "On 1,000 m² of such ground it shows {} false zones, those weights {}.",
            measured(f, "false_zones_per_1000_m2", ""), measured(f, "start_false_zones_per_1000_m2", ""),
        ),
        sentence("{} of the points that it was not trained on get their class.", percent(f, "overall_accuracy")),
    ]  # fmt: skip


def _survey(f: Figures) -> list[str]:
    return [
        sentence(
            "Two surveys of {} and {} points were simulated.",
            *(counted(f, f"points_{name}") for name in ("reference", "cloud")),
        ),
        sentence(
            "The later one holds {} changes: {} lowered and {} raised.",
            counted(f, "changes"), measured(f, "volume_lowered_m3", "m³"), measured(f, "volume_raised_m3", "m³"),
        ) if f.get("changes") or not f.get("motions") else "",
        sentence(
            "Places whose ground moves along its surface in the later one: {}, by up to {}.",
            counted(f, "motions"), measured(f, "largest_motion_m", "m"),
        ) if f.get("motions") else "",
    ]  # fmt: skip


def _simulated_series(f: Figures) -> list[str]:
    return [
        sentence(
            "{} surveys over {} days were simulated, {} points in all.",
            *(counted(f, name) for name in ("surveys", "days", "points")),
        ),
        sentence("{} zones creep in them.", counted(f, "zones")),
    ]


def _scenes(f: Figures) -> list[str]:
    return [
        sentence(
            "{} scenes with {} points and {} hazards were simulated.",
            *(counted(f, name) for name in ("scenes", "points", "hazards")),
        ),
        sentence(
            "{} of the points are raised and {} lowered.",
            percent(f, "share_uplift"), percent(f, "share_subsidence"),
        ),
    ]  # fmt: skip


def _top_view(f: Figures) -> list[str]:
    ground = {"class_2": "those of class 2", "estimate": "those near a quick estimate, as there is no class 2"}
    shown = {"rgb": "the cloud's colours", "intensity": "its intensity", "height": "its relief"}
    return [
        sentence("{} points became rasters with cells of {}.", counted(f, "points"), measured(f, "cell_m", "m")),
        sentence("The picture shows {}.", shown.get(str(f.get("picture")), "")),
        sentence("There are {} in the median.", measured(f, "density", "returns/m²")),
        sentence("Ground returns are {}.", ground.get(str(f.get("ground")), "")),
    ]


def _region(f: Figures) -> list[str]:
    return [
        sentence(
            "The proposed region has {}, {} of the cloud's area with {} of its points; look at it before it is used.",
            measured(f, "area_m2", "m²"), percent(f, "area_share"), percent(f, "points_share"),
        )
    ]  # fmt: skip


def _flight(f: Figures) -> list[str]:
    return [
        sentence(
            "{} lines of {} in all take {} min; batteries: {}.",
            counted(f, "line_count"), measured(f, "line_length_m", "m"), _minutes(f.get("flight_time_s")),
            counted(f, "battery_count"),
        ),
        sentence(
            "They keep at least {} over the ground below, and {} from ground and known plants in any direction.",
            measured(f, "altitude_lowest_m", "m"), measured(f, "clearance_m", "m"),
        ),
        sentence(
            "At the median, {} returns a m² of map are of the ground, and two such surveys would show change above {}.",
            counted(f, "ground_per_m2"), measured(f, "level_m", "m"),
        ),
        sentence("Motion along the surface would show above {}.", measured(f, "motion_m", "m")),
        *_season(f.get("season") or {}),
    ]  # fmt: skip


_NO_SEASON = {
    "one survey": "Only one survey of a known date was given, so nothing is said of other seasons.",
    "one month": "All dated surveys are of one month, so nothing is said of other seasons.",
    "small": "The dated surveys have too few places in common to tell seasons apart.",
    "strips": "Flight strips of one survey differ in the ground that they saw as much as the months do, so no month is "
    "named.",
}


def _season(f: Figures) -> list[str]:
    """Which month the dated surveys name, and what its ground does for the planned flight."""
    if not f:
        return []
    shares = f["ground_share_by_month"]
    if f["reason"] == "alike":
        low, high = ({"share": choose(shares.values())} for choose in (min, max))
        return [
            sentence(
                "By the dated surveys the season matters little: {} to {} of the pulses reached the ground.",
                percent(low, "share"), percent(high, "share"),
            )
        ]  # fmt: skip
    if f["reason"]:
        return [_NO_SEASON.get(f["reason"], "")]
    best, worst = (str(f[name]) for name in ("best_month", "worst_month"))
    figures = (best, percent(shares, best), worst, percent(shares, worst))
    others = ", ".join(str(month) for month in f["as_good"])
    if others:
        return [
            sentence(
                "Of the months surveyed, month {} shows the most ground: {} of the pulses reached it, in month {} {}; "
                "as good as that: month {}.",
                *figures, others,
            )
        ]  # fmt: skip
    return [
        sentence(
            "Of the months surveyed, month {} shows the most ground: {} of the pulses reached it, in month {} {}.",
            *figures,
        )
    ]


_VERDICTS = {
    "kept": "The flight kept its plan.",
    "lines": "The flight departed from its plan in its lines; its returns reach what was promised.",
    "places": "The flight fell short of its plan in its returns.",
    "lines and places": "The flight departed from its plan in its lines, and fell short of it in its returns.",
}


def _compared(f: Figures) -> list[str]:
    left_out = ", ".join(str(number) for number in f.get("left_out") or ())
    parts = ", ".join(
        f"{number} ({percent({'s': share}, 's')})" for number, share in (f.get("partly_flown") or {}).items()
    )
    elsewhere = ", ".join(
        f"{number} ({round(aside, 1) + 0.0:+.1f}, {round(above, 1) + 0.0:+.1f})"
        for number, (aside, above) in (f.get("elsewhere_m") or {}).items()
    )
    covered, returns, ground = (percent(f, name) for name in ("covered_share", "returns_ratio", "ground_ratio"))
    lines = counted(f, "flown_lines"), counted(f, "planned_lines")
    return [
        _VERDICTS.get(str(f.get("verdict")), ""),
        sentence("{} of {} planned lines were flown; left out: {}.", *lines, left_out)
        if left_out
        else sentence("{} of {} planned lines were flown.", *lines),
        sentence("Flown in part: {}.", parts),
        sentence("Lines flown elsewhere than planned (metres to the right, metres higher): {}.", elsewhere),
        sentence(
            "{} of the region's places have returns; all returns reach {}, those of the ground {} of what was "
            "promised.",
            covered,
            returns,
            ground,
        )
        if ground
        else sentence(
            "{} of the region's places have returns; all returns reach {} of what was promised.", covered, returns
        ),
        sentence(
            "{} of {} places fell short by more than 15 %.", counted(f, "short_places"), counted(f, "judged_places")
        ),
    ]


def _minutes(seconds: float | None) -> str:
    return "" if seconds is None else f"{max(1, round(seconds / 60))}"


def _located(f: Figures) -> list[str]:
    return [
        sentence(
            "{} of {} features have their place on the road now.", counted(f, "located"), counted(f, "features")
        ),
        sentence("{} have none; the field location_note says why.", counted(f, "not_located")) if f.get(
            "not_located") else "",
    ]  # fmt: skip


def _tasks(f: Figures) -> list[str]:
    return [
        sentence(
            "{} pictures with {} regions are ready for Label Studio.", counted(f, "pictures"), counted(f, "regions")
        )
    ]


def _labels(f: Figures) -> list[str]:
    return [
        sentence(
            "{} regions of {} tasks became {} polygons, {} in all.",
            *(counted(f, name) for name in ("regions", "tasks", "polygons")), measured(f, "area_m2", "m²"),
        )
    ]  # fmt: skip


def _handed_over(f: Figures) -> list[str]:
    return [
        sentence(
            "{} files were handed over, with {} layers and {} rasters.",
            *(counted(f, name) for name in ("files", "layers", "rasters")),
        ),
        sentence("Among them are the results of {} slopes.", counted(f, "slopes")),
        sentence(
            "{} zones and {} events are in the database; {} entries are new in its history.",
            *(counted(f, f"database_{name}") for name in ("zones", "events", "history")),
        ),
    ]


def _project(f: Figures) -> list[str]:
    return [sentence("The project has {} layers and a print layout.", counted(f, "layers"))]


OF_TOOLS: dict[str, Callable[[Figures], list[str]]] = {
    "train": _train,
    "topview": _top_view,
    "suggestroi": _region,
    "planflight": _flight,
    "compareflight": _compared,
    "locate": _located,
    "exportgis": _handed_over,
    "createproject": _project,
    "exportlabelstudio": _tasks,
    "importlabelstudio": _labels,
    "simulate survey": _survey,
    "simulate series": _simulated_series,
    "simulate scenes": _scenes,
}
"""By command."""
