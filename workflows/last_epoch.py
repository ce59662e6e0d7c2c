"""Screening within an inspection: the ground of the last epoch, and the evidence of the change for the zones found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ..engine.change.result import Change
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.epochs.epoch import Epoch
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.zones.confirmation import VERDICTS, confirm_zones
from ..interface.parameters import InputParameters, LastEpochParameters
from ..models.screening.cloud_file import ScreenedFile
from ..models.screening.method import learned_model
from ..models.screening.result import Screening
from ..models.screening.screen import screen_points
from ..models.screening.self_test import SelfTest, self_test
from ..models.screening.zones import Hazards, outline_hazards
from .products.screening import Pictured, default_targets, screening_facts, screening_figures, write_products
from .run import Run

_TARGETS = default_targets(Path("screened.laz"))
SCREENING_OUTPUTS = tuple(path.name for path in _TARGETS.values())
_KEYS = {name: path.stem for name, path in _TARGETS.items()}  # screened, screened_zones and so on


@dataclass(frozen=True)
class EpochScreening:
    """A screened epoch; ``tested`` where a self-test was asked for; ``note`` is the evidence of the change for its
    zones, empty where there is none.
    """

    source: ScreenedFile
    screening: Screening
    hazards: Hazards
    tested: SelfTest | None
    figures: dict[str, int]
    note: str = ""


def obstacle(parameters: LastEpochParameters) -> str | None:
    """Why this machine cannot screen, as a sentence; None if it can.

    Raises:
        InputError: what was asked for by name, weights or a graphics card, cannot be used.
    """
    try:
        learned_model(parameters)
    except InputError as error:
        if parameters.weights or parameters.device == "gpu":
            raise
        return str(error)
    return None


def screen_epoch(
    ground: Path, epoch: Epoch, parameters: LastEpochParameters, *, run_id: str, progress: Progress
) -> EpochScreening:
    """Screen the ground cloud ``ground`` of ``epoch``; messages name the epoch's own file.

    Raises:
        InputError: the slope or its density does not suit the screening (see ``screening.screen_points``).
        EngineError: memory ran out.
    """
    source = ScreenedFile(ground, InputParameters(), ground=parameters.ground, known_as=epoch.path, progress=progress)
    source.refuse_classes(parameters.write_classification)
    end = 0.3 if parameters.self_test else 0.9
    with progress.stage(0.0, end, "screening"):
        screening = screen_points(source, parameters, progress)
    with progress.stage(end, end + 0.1, "outlining screened zones"):
        hazards = outline_hazards(screening, source.frame.crs, parameters, run_id=run_id)
    tested = None
    if parameters.self_test:
        with progress.stage(end + 0.1, 1.0, "self-test"):
            tested = self_test(source, screening, hazards, parameters, progress)
    return EpochScreening(source, screening, hazards, tested, {})


def confirmed_by(found: EpochScreening, change: Change, epochs: tuple[Epoch, Epoch]) -> EpochScreening:
    """The screening with a verdict on each zone (see ``confirmation``) and how many have which."""
    frame = confirm_zones(found.hazards.frame, change, outline_cell=found.hazards.grid.cell)
    count = {word: int((frame["confirmed"] == word).sum()) for word in VERDICTS}
    counted = ", ".join(f"{number} {word}" for word, number in count.items() if number)
    note = f"Change {epochs[0].name} to {epochs[1].name}: {counted}." if counted else ""
    return replace(
        found,
        hazards=replace(found.hazards, frame=frame),
        figures={f"{word.replace(' ', '_')}_zones": number for word, number in count.items()},
        note=note,
    )


def write_epoch_screening(
    run: Run,
    found: EpochScreening,
    picture: PointCloud | CloudFile,
    epoch: Epoch,
    digest: str,
    parameters: LastEpochParameters,
) -> None:
    """Write labelled cloud, zones, rasters and map; ``run`` gets their paths and the main figures.

    Args:
        picture: the cloud that the map's top view shows, in the frame of the screened one.
        digest: SHA-256 of the epoch's own file.
    """

    def place(path: Path) -> Path:
        return run.stage.path(path.name)

    facts = screening_facts(found.source, found.screening, found.tested)
    note = f"{found.note} {facts.get('not_shown', '')}".strip()
    shown = Pictured(picture, digest, survey=epoch.date, name=epoch.name, note=note)
    write_products(_TARGETS, place, found.hazards, shown, run)
    labelled = found.source.write_labelled(
        place(_TARGETS["labelled"]), found.screening, classification=parameters.write_classification
    )
    figures = screening_figures(found.source, found.screening, found.hazards, labelled, found.tested)
    figures = {name if name.startswith("screened") else f"screened_{name}": value for name, value in figures.items()}
    run.facts |= {"screening_method": found.screening.method} | facts
    run.outputs |= {key: run.stage.final(_TARGETS[name].name) for name, key in _KEYS.items()}
    run.figures |= figures | found.figures
