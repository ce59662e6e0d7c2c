"""Results of a run that a later command reads: folders that are handed over, reported again or gone on with."""

from __future__ import annotations

import json
from pathlib import Path

from slopewatch.lab.fuzz import mutations
from slopewatch.lab.fuzz.mutations import Mutation
from slopewatch.lab.fuzz.target import Target, sound
from slopewatch.tests.builders import elevation_models, known_changes, known_truth
from slopewatch.tests.builders.elevation_models import hills, noise

READY = ("--ground-ready", "--no-rasters-each-survey", "--cell", "0.5", "--method", "none")
_FEW = ("--surface-points", "900")
_BY_ENDING: dict[str, Mutation] = {
    ".json": mutations.changed_json,
    ".gpkg": mutations.changed_database,
    ".tif": mutations.changed_tags,
    ".csv": mutations.changed_table,
    ".npz": mutations.changed_bytes,
}


def targets(folder: Path, clouds: list[Path]) -> list[Target]:
    """All of them, on results that are made in ``folder``."""
    pit, moved, watched = _pit(folder), _moved(folder), _watched(folder, clouds)
    over, report = ("exportgis", "FOLDER", *_FEW, "--output", "OUT/h"), ("report", "FOLDER")
    agreed = pit.parent / "agreed.json"
    agreed.write_text(json.dumps({"zone_id": "SITE", "zones": {"area_m2": "AREA"}}), encoding="utf-8")
    renamed = ("exportgis", str(pit), *_FEW, "--fields", "FILE", "--output", "OUT/h")
    again = ("series", *(f"--epoch={p.stem}={p}" for p in clouds), *READY, "--overwrite", "--output-dir", "FOLDER")
    return [
        Target("fields.json", agreed, mutations.changed_json, renamed, named=("mapping file",)),
        *(
            _of("handed", pit, name, over)
            for name in ("run.json", "zones.gpkg", "surface_heights.tif", "elevation_change.tif", "profiles.csv")
        ),
        *(_of("moved", moved, name, over) for name in ("run.json", "displacement.gpkg", "displacement.tif")),
        *(_of("report", moved, name, report) for name in ("run.json", "displacement.gpkg", "displacement.tif")),
        *(_of("watched", watched, name, over) for name in ("run.json", "series.gpkg")),
        *(
            Target(f"work.{kind}", watched / name, _BY_ENDING[Path(name).suffix], again, watched)
            for kind, name in _kept(watched).items()
        ),
    ]


def _of(word: str, folder: Path, name: str, command: tuple[str, ...]) -> Target:
    path = folder / name
    return Target(f"{word}.{path.name}", path, _BY_ENDING[path.suffix], command, folder)


def _pit(folder: Path) -> Path:
    """A pit between two elevation models, with a section."""
    made = folder / "pit"
    models = []
    for i, lowered in enumerate((0.0, -0.8)):
        heights = hills(70, 70) + noise((70, 70), 0.03, 3.0, i)
        heights[30:45, 30:45] += lowered
        models.append(str(elevation_models.write_model(folder / f"{2018 + i}-03-01.tif", heights)))
    sound(made, "demchange", *models, "--output-dir", str(made))
    return made


def _moved(folder: Path) -> Path:
    """Ground of which half moved along its surface."""
    made, place = folder / "moved", folder / "rough"
    place.mkdir(exist_ok=True)
    if not made.exists():
        known_changes.write_clouds(place)
    first, later = (str(place / f"{day}.laz") for day in known_truth.DAYS)
    sound(made, "displacement", first, later, "--output-dir", str(made))
    return made


def _watched(folder: Path, clouds: list[Path]) -> Path:
    made = folder / "series_to_go_on"
    sound(made, "series", *(f"--epoch={p.stem}={p}" for p in clouds), *READY, "--output-dir", str(made))
    return made


def _kept(folder: Path) -> dict[str, str]:
    """One file of each kind that a series keeps to go on with, by the kind."""
    found: dict[str, str] = {}
    for path in sorted((folder / "work").glob("*")):
        if path.suffix in (".json", ".npz"):
            found.setdefault(path.name.partition("_")[2], f"work/{path.name}")
    return found
