"""What makes a measured change doubtful, as warnings."""

from __future__ import annotations

from ...interface.seen import COMPARED, MIN_SEEN_SHARE
from ..core.progress import Progress
from .coverage import cell_that_compares, seen
from .result import Change

_MIN_REPORTED_AREA_M2 = 1.0  # m² of change that plants explain: less comes by chance where plants end


def warn_of_doubtful_change(change: Change, progress: Progress, *, may_grow: bool = True, of_pair: bool = True) -> None:
    """Warn of ground that was not compared and of a shift of the whole overlap.

    Args:
        may_grow: whether cells that grow can be asked for where this warning is read.
        of_pair: whether the run compares this pair alone, and so says what the seasons of the two do.
    """
    compared = seen(change).share(COMPARED)
    if compared < MIN_SEEN_SHARE:
        remedy = "check that both cover the same slope"
        if change.partition.grown:
            remedy += ", or give a larger largest_cell"
        elif larger := cell_that_compares(change):
            growing = ", or cells that grow (adaptive)," if may_grow else ""
            remedy = f"cells of {larger:g} m{growing} would compare most of it"
        progress.headline(
            f"Only {100 * compared:.2g} % of the slope was seen by both surveys; nothing is known of the rest, and "
            f"zones and volumes leave it out; {remedy}."
        )
    for note in change.model.notes:
        progress.warning(note)
    if of_pair:
        _warn_of_season(change, progress)
    shift = change.uniform_dz
    if shift is not None and change.season is not None and change.season.explains(shift):
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m, and the plants "
            "changed alike: most likely the plants, not a deformation; no zones are drawn. Register on bare ground, "
            "such as a road given as stable, or compare surveys of the same season."
        )
    elif shift is not None:
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m: a datum or height "
            "bias (such as ellipsoidal against orthometric heights), not a deformation; no zones are drawn. Check the "
            "height systems, or register first."
        )


def _warn_of_season(change: Change, progress: Progress) -> None:
    if change.season is not None and change.season.differs:
        progress.warning(change.season.sentence)
    explained = 0.0 if change.explained is None else float(change.explained.sum()) * change.grid.cell**2
    if explained >= _MIN_REPORTED_AREA_M2:
        progress.warning(
            f"{explained:.1f} m² of change beyond the level of detection may be "
            "that of the plants, which differ there by as much: it counts in no zone and no volume, and "
            "plant_change.tif shows it; look at the place where it matters."
        )
