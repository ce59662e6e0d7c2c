"""``slopewatch simulate scenes``: labelled scenes in an output folder."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import ScenesParameters, given
from ..simulation.hazard_scenes.picture import Panels, draw_panels, panels
from ..simulation.hazard_scenes.scenes import build_scene
from ..simulation.hazard_scenes.sets import SETS
from ..simulation.hazard_scenes.styles import SceneSpec, draw_spec
from ..simulation.hazard_scenes.write import scene_entry, scene_name, write_hazards, write_manifest, write_scene
from .run import Run

PICTURED = 12
"""Scenes in the picture, at most."""


def scene_specs(parameters: ScenesParameters) -> list[SceneSpec]:
    """The specifications of the scenes that the parameters ask for.

    Raises:
        InputError: more scenes than the benchmark set has.
    """
    if parameters.benchmark:
        specs = SETS[parameters.kind]().specs
        if parameters.count > len(specs):
            raise InputError(
                f"count is {parameters.count}, but the benchmark set {parameters.kind} has {len(specs)} scenes; give "
                f"at most {len(specs)}."
            )
        return list(specs[: parameters.count])
    return [
        draw_spec(
            parameters.seed + number, parameters.kind, area=given(parameters.area), density=given(parameters.density)
        )
        for number in range(parameters.count)
    ]


def scenes_step(
    parameters: ScenesParameters, output_dir: Path, progress: Progress, *, overwrite: bool = False
) -> RunResult:
    """Simulate scenes one after the other and write them with their truth; nothing is left when it fails.

    Returns:
        The outputs are ``scene`` (the first), ``scene_2`` and so on, ``hazards``, ``manifest``, ``picture`` if asked
        for, and ``run``.
    """
    specs = scene_specs(parameters)
    run = Run("simulate scenes", {parameters.record_name: parameters}, progress=progress)
    run.refuse_folder(output_dir, ("run.json", "manifest.json", "hazards.gpkg"), overwrite=overwrite)
    with run.writing(output_dir) as stage:
        made = _write_scenes(run, specs, pictured=PICTURED if parameters.picture else 0)
        progress.update(0.95, "writing the truth")
        write_hazards(stage.path("hazards.gpkg"), made.hazards)
        run.outputs["hazards"] = stage.final("hazards.gpkg")
        shares = write_manifest(stage.path("manifest.json"), parameters, made.entries)
        run.outputs["manifest"] = stage.final("manifest.json")
        if made.pictures:
            draw_panels(made.pictures, stage.path("scenes.png"))
            run.outputs["picture"] = stage.final("scenes.png")
        points = sum(entry["points"] for entry in made.entries)
        run.figures = {
            "scenes": len(made.entries),
            "points": points,
            **{f"share_{name}": share for name, share in shares.items()},
            "hazards": sum(entry["hazards"] for entry in made.entries),
            "simulated_points_per_cpu_second": points / max(made.cpu_seconds, 1e-9),
        }
    return run.result()


@dataclass
class _Made:
    """What the scenes written so far are, what is hazardous in each, and their panels of the picture."""

    entries: list[dict[str, Any]] = field(default_factory=list)
    hazards: list[tuple[str, np.ndarray]] = field(default_factory=list)
    pictures: list[Panels] = field(default_factory=list)
    cpu_seconds: float = 0.0


def _write_scenes(run: Run, specs: Sequence[SceneSpec], *, pictured: int) -> _Made:
    """Simulate and write one scene after the other, so that one at a time is held."""
    progress, stage, made = run.progress, run.stage, _Made()
    expected, done = float(sum(spec.points for spec in specs)), 0.0
    with run.step("simulate and write") as entry:
        for number, spec in enumerate(specs, start=1):
            name = scene_name(spec)
            progress.update(0.95 * done / expected, f"simulating scene {number} of {len(specs)}")
            started = time.process_time()
            scene = build_scene(spec)
            made.cpu_seconds += time.process_time() - started
            progress.update(0.95 * (done + 0.6 * spec.points) / expected, f"writing {name}")
            write_scene(stage.path(name), scene)
            made.entries.append(scene_entry(name, scene))
            made.hazards.append((name, scene.hazards))
            if len(made.pictures) < pictured:
                made.pictures.append(panels(scene))
            run.outputs["scene" if number == 1 else f"scene_{number}"] = stage.final(name)
            done += spec.points
            del scene
        entry["simulation_cpu_seconds"] = round(made.cpu_seconds, 3)
    return made
