"""How the shipped weights and their figures are made again: ``python -m slopewatch.lab.making``."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import click

from ...cli.options import Session, command
from ...engine.core.errors import InputError
from ...engine.core.run_result import RunResult
from ...engine.core.staged_outputs import atomic_output

FIGURES = Path(__file__).resolve().parents[2] / "models" / "weights" / "figures"
_folder = click.option(
    "--folder", type=click.Path(path_type=Path), required=True, help="For checkpoints; a broken run goes on from here."
)
_minutes = click.option("--minutes", type=float, default=float("inf"), help="Stop after so long; run again to go on.")
_device = click.option(
    "--device", type=click.Choice(["auto", "cpu", "gpu"]), default="auto", show_default=True, help="auto: gpu if any."
)


@click.group()
def main() -> None:
    """Make the shipped model and its figures again."""


@main.command()
@click.option("--recipe", type=click.Choice(["slopewatch", "paper", "paper-whole", "residual"]), default="slopewatch")
@click.option("--scenes", type=int, default=0, help="Only the first so many of the 92 scenes, for a trial.")
@click.option("--steps", type=int, default=0, help="Instead of the recipe's.")
@click.option(
    "--fold",
    "only",
    type=click.IntRange(0, 4),
    multiple=True,
    help="Only this one (0 to 4), so that processes can share them.",
)
@_device
@_folder
@command(profile=False)
def folds(
    session: Session, recipe: str, scenes: int, steps: int, only: tuple[int, ...], device: str, folder: Path
) -> RunResult:
    """Five folds by scene of the published set: train and score each."""
    from ...models.network.availability import chosen_device
    from ...models.training.recipes import RECIPES
    from ...simulation.hazard_scenes.sets import published_set
    from .folds import score_folds, score_residual

    _one_thread()
    specs = published_set().specs[: scenes or None]
    if recipe == "residual":
        summary = score_residual(specs, folder, progress=session.report)
    else:
        chosen = RECIPES[recipe].with_steps(steps) if steps else RECIPES[recipe]
        summary = score_folds(specs, chosen, folder, only=only, device=chosen_device(device), progress=session.report)
    path = folder / "folds.json"
    if not scenes and not steps and not only:
        path = _keep(f"folds_{recipe}.json", summary)
    return RunResult({"folds": path}, {name: summary[name]["mean"] for name in ("overall_accuracy", "mean_iou")})


@main.command()
@_minutes
@_device
@_folder
@command(profile=False)
def weights(session: Session, minutes: float, device: str, folder: Path) -> RunResult:
    """Train the shipped weights from nothing, calibrate them and write them with their description."""
    from ...models.network.availability import chosen_device
    from ...models.network.shipped import SHIPPED_WEIGHTS
    from ...models.network.weights import save_model
    from ...models.training.recipes import SHIPPED
    from ...simulation.hazard_scenes.styles import SIMULATOR_VERSION
    from .shipping import calibrate, train_shipped

    _one_thread()
    on = chosen_device(device)
    with session.report.stage(0.0, 0.95):
        made = train_shipped(
            SHIPPED,
            folder,
            processes=os.cpu_count() or 1,
            device=on,
            seconds=60 * minutes,
            progress=session.report,
        )
    if made is None:
        raise InputError(f"The time is over before the training is; run again with --folder {folder} to go on.")
    network, facts = made
    with session.report.stage(0.95, 1.0, "calibrating"):
        calibration = calibrate(network, session.report)
    metrics = {"calibration": calibration.summary()}
    digest = save_model(SHIPPED_WEIGHTS, network, facts, metrics, simulator_version=SIMULATOR_VERSION)
    with atomic_output(SHIPPED_WEIGHTS.with_name("slopewatch.sha256")) as partial:
        partial.write_text(f"{digest}  {SHIPPED_WEIGHTS.name}\n", encoding="ascii")
    with atomic_output(SHIPPED_WEIGHTS.with_name("training_log.csv")) as partial:
        partial.write_text((folder / "log.csv").read_text(encoding="utf-8"), encoding="utf-8")
    return RunResult({"weights": SHIPPED_WEIGHTS}, {"temperature": calibration.temperature, **facts})


@main.command("relief")
@click.option("--ground", type=click.Path(path_type=Path, exists=True, file_okay=False), help="Folder of real ground.")
@click.option("--leave-out", multiple=True, help="A survey that the network must not see, for tests on it.")
@click.option("--slopes", type=click.IntRange(min=0), default=60, show_default=True, help="Simulated slopes.")
@click.option("--steps", type=click.IntRange(min=1), default=3000, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
@_minutes
@click.option("--rate", type=float, default=4e-3, show_default=True, help="Learning rate at its peak.")
@click.option("--start", type=click.Path(path_type=Path, exists=True), help="Weights to start from.")
@click.option("--weights", "path", type=click.Path(path_type=Path), required=True, help="The .safetensors to write.")
@_folder
@command(profile=False)
def relief_weights(
    session: Session,
    ground: Path | None,
    leave_out: tuple[str, ...],
    slopes: int,
    steps: int,
    seed: int,
    rate: float,
    start: Path | None,
    minutes: float,
    path: Path,
    folder: Path,
) -> RunResult:
    """Train the network that reads rasters, on real ground and simulated slopes."""
    from ...models.network.unet import load_unet, save_unet
    from ...models.training.sim_on_real import ReliefTraining
    from .relief_weights import relief_grounds, train_relief_weights

    _one_thread()
    parameters = ReliefTraining(steps=steps, seed=seed, learning_rate=rate)
    grounds = relief_grounds(ground, leave_out, slopes, session.report)
    made = train_relief_weights(
        grounds,
        folder,
        parameters,
        left_out=leave_out,
        start=load_unet(start)[0] if start else None,
        seconds=60 * minutes,
        progress=session.report,
    )
    if made is None:
        raise InputError(f"The time is over before the training is; run again with --folder {folder} to go on.")
    network, facts = made
    save_unet(path, network, facts, {})
    return RunResult({"weights": path}, {"steps": steps, "processor_seconds": facts["processor_seconds"]})


@main.command()
@click.option("--residual", is_flag=True, help="Score the threshold without learning instead.")
@click.option("--set", "chosen", multiple=True, type=click.Choice(["published", "realistic", "shifted"]))
@_device
@command(profile=False)
def figures(session: Session, residual: bool, chosen: tuple[str, ...], device: str) -> RunResult:
    """Score the shipped weights, or the threshold, on the benchmark sets."""
    from ...models.inference.calibration import temperature_of
    from ...models.network.availability import chosen_device
    from ...models.network.shipped import shipped_model
    from ...models.network.weights import load_model
    from .shipping import score_set

    _one_thread()
    network, temperature, on = None, 1.0, chosen_device(device)
    if not residual:
        model = load_model(*shipped_model())
        network, temperature = model.network.to(on), temperature_of(model.metadata)
    outputs = {}
    names = chosen or ("realistic", "shifted", "published")
    for number, name in enumerate(names):
        with session.report.stage(number / len(names), (number + 1) / len(names), f"{name} set"):
            scores = score_set(name, network, temperature, device=on, progress=session.report)
        outputs[name] = _keep(f"{name}_{'residual' if residual else 'slopewatch'}.json", scores)
    return RunResult(outputs, {})


@main.command()
@click.option("--seconds", type=float, default=90.0, show_default=True, help="Of the processor, for each variant.")
@_folder
@command(profile=False)
def ablation(session: Session, seconds: float, folder: Path) -> RunResult:
    """Train with one choice changed at a time, each for the same time."""
    from .ablation import ablate

    _one_thread()
    found = ablate(folder, seconds, progress=session.report)
    return RunResult({"ablation": _keep("ablation.json", {"seconds": seconds, "variants": found})}, {})


@main.command()
@click.option(
    "--folds",
    "folders",
    multiple=True,
    type=(str, click.Path(path_type=Path)),
    metavar="RECIPE FOLDER",
    help="Where a recipe's folds were trained, for the time that they took.",
)
@command(profile=False)
def card(session: Session, folders: tuple[tuple[str, Path], ...]) -> RunResult:
    """Write the model card from the weights' description and the figures next to them."""
    from ...models.network.shipped import shipped_model, shipped_relief
    from ...models.network.unet import load_unet
    from ...models.network.weights import load_model
    from .model_card import model_card, read_figures, read_seconds

    times = FIGURES / "seconds.json"
    seconds = json.loads(times.read_text(encoding="utf-8")) if times.is_file() else {}
    seconds.update({recipe: read_seconds(folder) for recipe, folder in folders})
    _keep(times.name, seconds)
    path = FIGURES.parent / "README.md"
    relief = load_unet(*shipped_relief())[1]
    text = model_card(load_model(*shipped_model()).metadata, read_figures(FIGURES), seconds, relief)
    with atomic_output(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return RunResult({"card": path}, {})


def _keep(name: str, values: dict[str, Any]) -> Path:
    FIGURES.mkdir(parents=True, exist_ok=True)
    path = FIGURES / name
    with atomic_output(path) as partial:
        partial.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    return path


def _one_thread() -> None:
    """Two threads of OpenMP that wait for each other were slower than one on the machines measured."""
    import torch

    torch.set_num_threads(1)


if __name__ == "__main__":
    main()
