"""How a change between elevation models ends: their tilt or bend, and the change in figures if no zones were drawn."""

from __future__ import annotations

from .figures_in_words import Figures, measured, percent, sentence


def trend(f: Figures) -> str:
    """The tilt or bend between two models, and what became of it."""
    tilt, bend = (measured(f, f"{name}_m", "m", error=f"{name}_error_m") for name in ("tilt", "bend"))
    if f.get("trend") == "tilt":
        found = f"The models differ by a tilt of {tilt} over the map"
    elif f.get("trend") == "bend":
        found = f"The models differ by a bend of {bend} and a tilt of {tilt} over the map"
    else:
        return ""
    if f.get("trend_taken_off"):
        return f"{found}; that is taken off and is no change."
    return f"{found}; that was not taken off and may hide change."


def statistics(f: Figures) -> list[str]:
    """Of a change without zones."""
    return [
        sentence(
            "The change of all cells is {} in the mean and {} in the median, with a standard deviation of {}.",
            measured(f, "dz_mean_m", "m"), measured(f, "dz_median_m", "m"), measured(f, "dz_std_m", "m"),
        ),
        sentence(
            "On stable ground its NMAD is {} and its root mean square {}.",
            measured(f, "stable_dz_nmad_m", "m"), measured(f, "stable_dz_rms_m", "m"),
        ),
        sentence(
            "{} of the cells, {}, changed by more than their level of detection, {} in the median.",
            percent(f, "beyond_share"), measured(f, "beyond_m2", "m²"), measured(f, "level_median_m", "m"),
        ),
        sentence("The net volume of all cells is {}.", measured(f, "all_net_m3", "m³", error="all_net_err_m3")),
    ]  # fmt: skip
