"""``slopewatch train``: labelled clouds in, weights with their description, log and report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.core.errors import InputError
from ..engine.core.input_files import refuse_unusable
from ..engine.core.part_folders import settle
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import AUTO, FineTuneParameters, InputParameters, given
from ..models.network.availability import chosen_device, require_libraries
from ..models.network.description import kind_of
from ..models.preparation.inserted_hazards import BACKGROUND
from ..models.preparation.relative_scores import UPPER
from ..models.screening.method import DEFAULT, KINDS
from ..models.screening.relief import RELIEF_DENSITY
from ..models.training.own_data import OwnCloud, read_own_clouds
from ..models.training.report import training_report
from .run import Run

if TYPE_CHECKING:
    from ..models.network.weights import ModelFile
    from ..models.training.fine_tuning import FineTuned
    from ..models.training.relief_tuning import ReliefStart, ReliefTuned

NAMES = {
    "weights": "model.safetensors",
    "description": "model.json",
    "log": "log.csv",
    "report": "report.md",
    "run": "run.json",
}
SHIPPED_OR_NONE = ("shipped", "none")
POINTS_METHOD = "network"
WORK = "training"
"""Folder in the output folder that checkpoints and the folds' scores are kept in."""


def train_step(
    paths: Sequence[Path],
    output_dir: Path,
    parameters: FineTuneParameters,
    inputs: InputParameters,
    *,
    polygons: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Train on labelled clouds; everything given is checked before anything is written.

    Stopped and started again with the same values it goes on from the checkpoints in ``output_dir``/training. A model
    that the folder holds is replaced with ``overwrite`` only.

    Returns:
        The outputs are named as in ``NAMES``.

    Raises:
        InputError: torch or the graphics card is missing; the start weights cannot be used; see ``read_own_clouds``;
            the output folder holds another training or cannot be written.
    """
    files = [*(("cloud", path) for path in paths), ("polygons", polygons)]
    start_file = None if parameters.start in SHIPPED_OR_NONE else Path(parameters.start)
    refuse_unusable([*files, ("weights", start_file)])  # before torch is loaded
    require_libraries("Training")
    import torch

    from ..models.training.fine_tuning import fine_tune
    from ..models.training.relief_tuning import fine_tune_relief
    from ..models.training.tuning import collect_log

    output_dir = Path(output_dir)
    device = chosen_device(parameters.device)
    threads = given(parameters.threads)
    if threads:
        torch.set_num_threads(int(threads))
    start = start_weights(parameters)
    tune: Any = fine_tune_relief if trained_method(parameters) == "relief" else fine_tune
    run = Run("train", {p.record_name: p for p in (inputs, parameters)}, files, progress)
    first = start.path if start else None
    run.refuse_folder(output_dir, [*NAMES.values()], overwrite=overwrite, also=[first] if first else [])
    with run.step("read", 0.0, 0.04):
        clouds = read_own_clouds(paths, parameters, inputs, polygons, progress)
        labels_hash = run.hash_inputs()[-1]
    areas = None if polygons is None else {"name": polygons.name, "sha256": labels_hash}
    _warn(clouds, start, progress)
    if tune is fine_tune_relief:
        _warn_of_many_hazards(clouds, progress)
    with run.writing(output_dir) as stage:
        with run.step("train", 0.04, 0.98):
            model = start.model if start else None
            tuned = tune(clouds, model, parameters, output_dir / WORK, device=device, progress=progress)
        metrics = {
            "cross_validation": tuned.scores,
            "calibration": tuned.calibration.summary() if tuned.calibration else None,
        }
        facts = training_facts(clouds, start, parameters, tuned, areas, torch.__version__)
        digest = tuned.save(stage.path(NAMES["weights"]), facts, metrics)
        collect_log(output_dir / WORK, tuned.folds, stage.path(NAMES["log"]))
        report = training_report(facts, metrics, digest, progress.warnings)
        stage.path(NAMES["report"]).write_text(report, encoding="utf-8")
        run.outputs |= {key: stage.final(name) for key, name in NAMES.items()}
        run.figures = _figures(clouds, tuned)
        run.facts |= {"weights_sha256": digest, "start": facts["start"], "device": str(device)}
    return run.result()


@dataclass(frozen=True)
class Start:
    """Weights to start from: their file and name, what was read, and the points a m² that they were made for."""

    path: Path
    name: str
    model: ModelFile | ReliefStart
    density: tuple[float, float]


def trained_method(parameters: FineTuneParameters) -> str:
    """The method of screening whose network is trained, by the rule of screening: what the weights given are for, or
    the default without any.

    Raises:
        InputError: the weights are missing or undescribed, or of another network than the one asked for.
    """
    wanted = {"relief": "relief", "standard": "network", "smoke": "network"}.get(parameters.network, AUTO)
    if parameters.start in SHIPPED_OR_NONE:
        return DEFAULT if wanted == AUTO else wanted
    path = Path(parameters.start)
    settle(path.parent)
    if path.suffix != ".safetensors" or not path.with_suffix(".json").is_file():
        return POINTS_METHOD if wanted == AUTO else wanted  # reading it says what is wrong
    kind = kind_of(path)
    fitting = [name for name, read in KINDS.items() if read == kind]
    if not fitting or wanted not in (*fitting, AUTO):
        raise InputError(
            f"The weights {path} are those of a {kind}, which --network {parameters.network} is not; give --network "
            "auto, or other weights."
        )
    return fitting[0]


def start_weights(parameters: FineTuneParameters) -> Start | None:
    """The weights to start from, checked.

    Raises:
        InputError: missing, pickled, tampered with, of another version or network, or with other classes.
    """
    from ..models.network.weights import load_model
    from ..models.training.relief_tuning import ReliefStart

    method = trained_method(parameters)
    if parameters.start == "none":
        return None
    path, pin = _shipped(method) if parameters.start == "shipped" else (Path(parameters.start), None)
    if method == "relief":
        return Start(path, path.stem, ReliefStart.read(path, pin), RELIEF_DENSITY)
    model = load_model(path, pin)
    return Start(path, model.configuration.name, model, model.configuration.density)


def _shipped(method: str) -> tuple[Path, str]:
    from ..models.network.shipped import shipped_model, shipped_relief

    try:
        return shipped_relief() if method == "relief" else shipped_model()
    except InputError as error:
        raise InputError(
            "This copy of SlopeWatch comes without weights; install it again, or give --start FILE or --start none."
        ) from error


def _warn(clouds: Sequence[OwnCloud], start: Start | None, progress: Progress) -> None:
    if len(clouds) == 1:
        progress.warning(
            "With one file no honest score is possible: there is nothing to score on that was not trained on; give two "
            "or more, best from different slopes."
        )
    if start is None:
        return
    low, high = start.density
    for cloud in clouds:
        if not low <= cloud.density <= high:
            progress.warning(
                f"{cloud.name} has {cloud.density:.0f} points a m² where the weights that training starts from were "
                f"made for {low:g} to {high:g}."
            )


def _warn_of_many_hazards(clouds: Sequence[OwnCloud], progress: Progress) -> None:
    """Scores on relief are measured against the bulk of a slope, which must be background (see ``relative_scores``)."""
    for cloud in clouds:
        share = float((cloud.labels[cloud.known] != BACKGROUND).mean())
        if share > 1.0 - UPPER:
            progress.warning(
                f"{cloud.name} is labelled as hazard on {100 * share:.0f} % of its known points. Screening by relief "
                "tells hazards from the rest of the slope and finds few where they cover more than "
                f"{100 * (1.0 - UPPER):.0f} %; give larger parts of the slope, or train with --network standard."
            )


def training_facts(
    clouds: Sequence[OwnCloud],
    start: Start | None,
    parameters: FineTuneParameters,
    tuned: FineTuned | ReliefTuned,
    polygons: dict[str, str] | None,
    torch_version: str,
) -> dict[str, Any]:
    """What the model's description states of its training; ``polygons`` are name and SHA-256 of the file of labels."""
    names = [cloud.name for cloud in clouds]
    return {
        "start": None if start is None else {"name": start.name, "sha256": start.model.sha256},
        "network": trained_method(parameters),
        "parameters": asdict(parameters),
        "steps": tuned.steps,
        "files": [
            {
                "name": cloud.name,
                "sha256": cloud.sha256,
                "labels_sha256": cloud.labels_sha256,
                "points": cloud.counts,
                "density": round(cloud.density, 1),
            }
            for cloud in clouds
        ],
        "polygons": polygons,
        "folds": [
            {"train": [names[k] for k in fold.train], "test": [names[k] for k in fold.test]} for fold in tuned.folds
        ],
        "torch": torch_version,
    }


def _figures(clouds: Sequence[OwnCloud], tuned: FineTuned | ReliefTuned) -> dict[str, Any]:
    scores = tuned.scores or {}
    figures: dict[str, Any] = {
        "files": len(clouds),
        "labelled_points": int(sum(cloud.known.sum() for cloud in clouds)),
        "folds": len(tuned.folds),
        "steps": tuned.steps,
    }
    for name in ("overall_accuracy", "mean_iou", "majority_accuracy", "start_overall_accuracy", "start_mean_iou"):
        figures[name] = scores.get(name)
    return figures | tuned.figures()
