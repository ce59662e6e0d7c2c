"""``slopewatch compareflight``: a plan and the survey that was flown in, what was kept and what fell short out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS

from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.crs.working_frame import same_horizontal
from ..engine.flight.comparison import Comparison, Promised, compared
from ..engine.flight.flown_lines import MAX_DEVIATION_M, STATES
from ..engine.flight.flown_places import counts_of
from ..engine.flight.flown_tracks import read_trajectory
from ..engine.flight.plan import MAX_PLACES
from ..engine.grid.grid import snapped_grid
from ..engine.pointcloud.reading import read_cloud
from ..engine.pointcloud.times import read_flown
from ..engine.vector.geopackage import has_shapes, read_layer
from ..interface.parameters import InputParameters
from .products.compareflight import COMPARISON_OUTPUTS, write_comparison
from .run import Run

_GROUND_CLASS = 2
MAX_SHORT_SHARE = 0.05
"""Share of the places up to which a flight with places that fell short has kept its plan."""


def compareflight_step(
    plan: Path,
    cloud: Path,
    output_dir: Path,
    inputs: InputParameters,
    *,
    ground: Path | None = None,
    trajectory: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Compare the survey that was flown with its plan, line by line and place by place.

    Args:
        plan: the plan.gpkg of ``planflight``.
        cloud: the survey as flown, with all its returns.
        ground: its ground; None: the returns of class 2 of ``cloud``, where it has any.
        trajectory: CSV with time, x, y, z of the carrier; None: its way is that of the scan angles, where
            these show it.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    files = [("plan", plan), ("cloud", cloud), ("ground", ground), ("trajectory", trajectory)]
    run = Run("compareflight", {"inputs": inputs}, files, progress)
    run.refuse_folder(output_dir, ("run.json", *COMPARISON_OUTPUTS), overwrite=overwrite)
    run.hash_inputs()
    with run.step("read", 0.0, 0.6, "reading the survey"):
        promised = read_promised(plan)
        points, below = read_flown_survey(cloud, ground, inputs, promised, progress)
        path = None if trajectory is None else read_trajectory(trajectory)
    with run.step("compare", 0.6, 0.9, "comparing with the plan"):
        made = compared(promised, points, below, read_flown(cloud), path)
        _say(made, progress)
    with run.writing(output_dir):
        with run.step("products", 0.9, 1.0, "writing the comparison"):
            write_comparison(run, made)
        run.figures = comparison_figures(made)
    return run.result()


def read_promised(path: Path) -> Promised:
    """Lines and places of a plan.

    Raises:
        InputError: it is no plan of ``planflight``.
    """
    lines, places = read_layer(path, "lines"), read_layer(path, "places")
    named = "line" in lines.columns and {"returns_m2", "ground_m2"} <= set(places.columns)
    if not named or not has_shapes(lines) or not has_shapes(places) or lines.crs is None:
        raise InputError(f"{shown(path)} holds no flight lines with places; give the plan.gpkg of an earlier plan.")
    bounds = places.geometry.bounds.to_numpy()
    cell = float(np.median(bounds[:, 2] - bounds[:, 0]))
    middle = bounds[:, :2] + (bounds[:, 2:] - bounds[:, :2]) / 2
    reach = middle.max(axis=0) - middle.min(axis=0)
    if not (np.isfinite(bounds).all() and cell > 0 and np.prod(reach / cell + 1) <= MAX_PLACES):
        raise InputError(f"{shown(path)} has places without a shape or too far apart; give the plan.gpkg of a plan.")
    grid = snapped_grid((*middle.min(axis=0), *middle.max(axis=0)), cell)
    row = np.floor((grid.north - middle[:, 1]) / cell).astype(int)
    column = np.floor((middle[:, 0] - grid.west) / cell).astype(int)
    returns, ground = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
    returns[row, column], ground[row, column] = places["returns_m2"], places["ground_m2"]
    ordered = [shapely.get_coordinates(g, include_z=True) for g in lines.sort_values("line").geometry]
    return Promised(ordered, returns, ground, grid, CRS.from_user_input(lines.crs))


def read_flown_survey(
    path: Path, ground: Path | None, inputs: InputParameters, promised: Promised, progress: Progress
) -> tuple[Float, Float | None]:
    """All returns (n, 3) of the survey flown and those of the ground (m, 3), None where no ground is known.

    Raises:
        InputError: another reference system than the plan's, or no return in its places.
    """
    cloud = read_cloud(path, inputs, progress=progress)
    _refuse_other_system(path, cloud.crs, promised)
    counts, _ = counts_of(cloud.xyz, promised.grid)
    if not counts[np.isfinite(promised.returns)].any():
        raise InputError(f"{shown(path)} has no return in the region of the plan; give the survey flown by this plan.")
    if ground is None:
        own = None if cloud.classification is None else cloud.classification == _GROUND_CLASS
        return cloud.xyz, cloud.xyz[own] if own is not None and own.any() else None
    below = read_cloud(ground, inputs)
    _refuse_other_system(ground, below.crs, promised)
    own = None if below.classification is None else below.classification == _GROUND_CLASS
    return cloud.xyz, below.xyz[own] if own is not None and own.any() else below.xyz


def _refuse_other_system(path: Path, crs: CRS, promised: Promised) -> None:
    if not same_horizontal(crs, promised.crs):
        raise InputError(
            f"{shown(path)} is in {crs.name} and the plan in {promised.crs.name}; give both in one reference system."
        )


def _say(made: Comparison, progress: Progress) -> None:
    if made.how == "none":
        progress.warning(
            "Neither a trajectory nor scan angles across the flight show where the carrier was, so only densities are "
            "compared; give --trajectory."
        )
    if made.ground is None:
        progress.warning(
            "No return is classified as ground (class 2), so only all returns are compared; give --ground."
        )
    if np.isfinite(made.promised.returns).sum() > 0 and not made.returns.whole:
        progress.warning("The cloud ends at the region, so places at its rim are not judged.")


def comparison_figures(made: Comparison) -> dict[str, Any]:
    """The figures that are read first; lines by their numbers in the plan."""
    states = {state: [line for line in made.lines if line.state == state] for state in STATES}
    inside = np.isfinite(made.promised.returns)
    judged = made.returns if made.ground is None else made.ground
    high = [line for line in made.lines if line.deviates and abs(line.above) > MAX_DEVIATION_M]
    aside = [line for line in made.lines if line.deviates and abs(line.aside) > MAX_DEVIATION_M]
    known = [line for line in made.lines if line.state != "left out"]
    figures: dict[str, Any] = {
        "planned_lines": len(made.promised.lines),
        "way_known_by": made.how,
        "strips": len(made.strips),
        "covered_share": float((made.returns.reached[inside] > 0).mean()),
        "returns_ratio": made.returns.ratio,
        "ground_ratio": None if made.ground is None else made.ground.ratio,
        "short_share": judged.short_share,
        "short_places": int(judged.short.sum()),
        "judged_places": int(judged.judged.sum()),
    }
    if made.lines:
        figures |= {
            "flown_lines": len(states["flown"]),
            "left_out": [line.number for line in states["left out"]],
            "partly_flown": {str(line.number): line.share for line in states["partly flown"]},
            "above_m": {str(line.number): line.above for line in high},
            "aside_m": {str(line.number): line.aside for line in aside},
            "elsewhere_m": {str(line.number): [line.aside, line.above] for line in made.lines if line.deviates},
            "largest_above_m": max((abs(line.above) for line in known), default=None),
            "largest_aside_m": max((abs(line.aside) for line in known), default=None),
        }
    return {**figures, "verdict": verdict_of(figures)}


def verdict_of(figures: dict[str, Any]) -> str:
    """kept, or fell short: a line that is missing or elsewhere, a place without returns, or 5 % of the places short."""
    lines = any(figures.get(name) for name in ("left_out", "partly_flown", "above_m", "aside_m"))
    places = figures["short_share"] > MAX_SHORT_SHARE or figures["covered_share"] < 1 - MAX_SHORT_SHARE
    if lines:
        return "lines and places" if places else "lines"
    return "places" if places else "kept"
