"""The model card: what the shipped weights are, what they were measured at, what they must not be used for.

Every figure comes from the description of the weights and the scores next to them; the text states no number itself.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..configuration import CLASSES

SETS = ("published", "realistic", "shifted")
RECIPES = {"slopewatch": "SlopeWatch", "paper": "published pipeline", "residual": "threshold on the residual"}
_USE = """\
## What it is for

It tells where the bare ground of one survey of a soil or rock cut, flown by LiDAR, stands out of the slope around it or
lies below it, so that people look there first. It reads x, y and z alone.

## What it must not be used for

- To call a slope free of danger. It sees shape, not movement: what it leaves unmarked may move, and what it marks may
  have had this shape since it was cut. Only a second survey tells.
- On natural ground that rolls or is broken: a part of its training is such ground, so that little of it is taken for
  hazards, but most hazards on it are missed (the shifted set below; `docs/figures.md` has real slopes).
- On clouds with vegetation on them (extract the ground first), on flat ground, walls, or two faces at once.
- On other densities than those stated above, or on clouds of photogrammetry, whose errors it never saw.
- Alone, for a decision on closing a road or on works.

It was trained and scored on simulated slopes only. Real ones have forms that the simulation lacks: expect more false
zones there, and fine-tune it (`slopewatch train`) as soon as a few slopes have been labelled.
"""


def read_figures(folder: Path) -> dict[str, Any]:
    """All scores that are kept next to the weights, by file name without its ending."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))}


def model_card(description: dict[str, Any], figures: dict[str, Any], seconds: dict[str, Sequence[float]]) -> str:
    """The card as Markdown.

    Args:
        description: of the weights (``weights.ModelFile.metadata``).
        figures: as ``read_figures`` gives them; a table is left out where its scores are not there.
        seconds: by recipe, the processor's seconds that a fold was trained in, on average, and scored in.
    """
    lines = ["# Model card: the shipped screening model", "", *_facts(description), "", _USE]
    lines += [*_folds(figures, seconds), *_sets(figures), *_amplitudes(figures), *_negatives(figures)]
    lines += [*_reliability(figures), *_ablation(figures), *_again(description)]
    return "\n".join(lines)


def read_seconds(folder: Path) -> tuple[float, float]:
    """Mean seconds of training and of scoring over the folds in a folder of ``benchmark_folds``."""
    rows = []
    for path in sorted(folder.glob("fold_*/seconds.csv")):
        with path.open(encoding="utf-8") as file:
            row = next(csv.DictReader(file))
        rows.append((float(row["training_s"]), float(row["scoring_s"])))
    return sum(r[0] for r in rows) / len(rows), sum(r[1] for r in rows) / len(rows)


def _facts(description: dict[str, Any]) -> list[str]:
    configuration, training = description["configuration"], description["training"]
    calibration = description["metrics"]["calibration"]
    trends = ", ".join(f"{along:g} x {up:g}" for along, up in configuration["trends"])
    return [
        (
            f"RandLA-Net (Hu et al. 2020) with {description['parameters']:,} parameters, written from the paper. "
            f"Classes: {', '.join(CLASSES)}. SHA-256 `{description['sha256']}`."
        ),
        "",
        "| | |",
        "|---|---|",
        f"| voxels | {configuration['voxel']:g} m |",
        (
            f"| density it is made for | {configuration['density'][0]:g} to {configuration['density'][1]:g} ground "
            "points/m² |"
        ),
        (
            f"| windows | {configuration['window']:g} m every {configuration['step']:g} m, "
            f"{configuration['neighbours']} neighbours, {_thinning(configuration)} |"
        ),
        (
            "| inputs | x, y, z in the slope's plane, and heights over robust trends that reach "
            f"(m along x m up the slope) {trends} |"
        ),
        (
            f"| trained on | {training['scenes']} simulated slopes, {training['points']:,} voxels, "
            f"{training['steps']:,} steps of {training['batch']} windows, simulator version "
            f"{description['simulator_version']} |"
        ),
        (
            f"| cost | {training['processor_seconds_preparing'] / 60:.0f} + "
            f"{training['processor_seconds_training'] / 60:.0f} minutes of one processor core "
            f"(preparing + training), torch {training['torch']}, seed {training['seed']} |"
        ),
        (
            f"| temperature | {calibration['temperature']:.3f}, fitted on {calibration['points']:,} points of scenes "
            "that training never saw |"
        ),
        *_groups(configuration),
    ]


def _groups(configuration: dict[str, Any]) -> list[str]:
    """What makes a group of voxels a hazard, where the model judges them together."""
    least = configuration.get("least_peak", 0.0)
    if not least:
        return []
    return [f"| groups | neighbouring voxels none of which is a hazard by {_percent(least)} % are none |"]


def _thinning(configuration: dict[str, Any]) -> str:
    """How a quarter of the points goes on to the next level; models that do not name it draw them at random."""
    how = {"random": "at random", "grid": "evenly"}[configuration.get("sampling", "random")]
    looks = configuration.get("thinnings", 1)
    return f"points thinned {how} from level to level" + (f", {looks} looks at each window" if looks > 1 else "")


def _folds(figures: dict[str, Any], seconds: dict[str, Sequence[float]]) -> list[str]:
    rows = []
    for recipe, name in RECIPES.items():
        found = figures.get(f"folds_{recipe}")
        if found is None:
            continue
        cost = seconds.get(recipe)
        rows.append(
            [
                name,
                _range(found["overall_accuracy"]),
                _range(found["mean_iou"]),
                *(_percent(found["iou"][c]) for c in CLASSES),
                f"{cost[0] / 60:.1f} min" if cost else "none",
            ]
        )
    if not rows:
        return []
    return [
        "## Published set, five folds by scene",
        "",
        (
            "92 simulated scenes; each point of each scene scored by a model that was trained on other scenes, no "
            "ignore band. Both recipes have the same budget of processor time a fold. The weights shipped are not "
            "these models: they are trained longer, on other scenes on which hazards are as rare as on real slopes, "
            "and read heights in units of the slope's own roughness; how their points are thinned is said above, here "
            "it is evenly for SlopeWatch, each window looked at twice, and at random for the published pipeline."
        ),
        "",
        *_table(
            ["", "accuracy % (range)", "mean IoU % (range)", *(f"IoU {c} %" for c in CLASSES), "training a fold"],
            rows,
        ),
        "",
    ]


def _sets(figures: dict[str, Any]) -> list[str]:
    rows = []
    for name in SETS:
        for recipe in ("slopewatch", "residual"):
            found = figures.get(f"{name}_{recipe}")
            if found is None:
                continue
            recall = found["recall_15_cm_2_m"]
            rows.append(
                [
                    name,
                    "shipped" if recipe == "slopewatch" else "threshold",
                    f"{found['points'] / 1e6:.1f} M",
                    _percent(found["overall_accuracy"]),
                    _percent(found["mean_iou"]),
                    *(_percent(found["iou"][c]) for c in CLASSES),
                    _percent(found["calibration_error"]),
                    f"{_percent(recall['recall'])} of {recall['hazards']}",
                    f"{found['false_zones_per_1000_m2']:.2f}",
                ]
            )
    if not rows:
        return []
    return [
        "## The shipped weights on the benchmark sets",
        "",
        (
            "Found: hazards of at least 15 cm and 2 m of which at least half of the points have the right class. False "
            "zones: of at least 1 m², without a labelled point in or beside them. That the shifted set's ground rolls "
            "and has facets and treads was known when rolling ground and ground broken in flat pieces were added to "
            "the training, which are made in other ways; all else of it was not used."
        ),
        "",
        *_table(
            ["set", "", "points", "accuracy %", "mean IoU %", *(f"IoU {c} %" for c in CLASSES), "ECE %", "found %"]
            + ["false zones / 1,000 m²"],
            rows,
        ),
        "",
    ]


def _amplitudes(figures: dict[str, Any]) -> list[str]:
    lines: list[str] = []
    for key, title in (("recall_by_amplitude_m", "amplitude"), ("recall_by_size_m", "diameter")):
        found = [(name, figures[f"{name}_slopewatch"]) for name in SETS if f"{name}_slopewatch" in figures]
        if not found:
            return []
        ranges = list(found[0][1][key])
        rows = [
            [name, *(_of(scores[key].get(r, {"recall": None, "hazards": 0})) for r in ranges)] for name, scores in found
        ]
        lines += [f"### Hazards found, by {title} (m)", "", *_table(["set", *ranges], rows), ""]
    return lines


def _negatives(figures: dict[str, Any]) -> list[str]:
    found = [(name, figures[f"{name}_slopewatch"]) for name in SETS if f"{name}_slopewatch" in figures]
    kinds = sorted({kind for _, scores in found for kind in scores["wrong_share_by_negative"]})
    if not kinds:
        return []
    rows = []
    for kind in kinds:
        row = [kind]
        for _, scores in found:
            share, zones = scores["wrong_share_by_negative"].get(kind), scores["false_zones"].get(kind, 0)
            row.append("" if share is None else f"{_percent(share)} % / {zones / scores['scenes']:.2f}")
        rows.append(row)
    return [
        "### Background taken for a hazard, by what it is",
        "",
        "Share of its points, and false zones a scene.",
        "",
        *_table(["", *(name for name, _ in found)], rows),
        "",
    ]


def _reliability(figures: dict[str, Any]) -> list[str]:
    scores = figures.get("realistic_slopewatch")
    if scores is None:
        return []
    rows = [[_percent(c), _percent(h), _percent(share)] for c, h, share in scores["reliability"]]
    return [
        "### Calibration on the realistic set",
        "",
        *_table(["stated probability %", "right %", "share of points %"], rows),
        "",
    ]


def _ablation(figures: dict[str, Any]) -> list[str]:
    found = figures.get("ablation")
    if found is None:
        return []
    rows = [
        [
            row["variant"],
            f"{row['steps']:,}",
            _percent(row["overall_accuracy"]),
            _percent(row["mean_iou"]),
            f"{row['false_zones_per_1000_m2']:.1f}",
        ]
        for row in found["variants"]
    ]
    return [
        "## What each choice gives",
        "",
        (
            f"Each trained for {found['seconds']:.0f} seconds of one processor core on the same scenes, one choice "
            "changed at a time, and scored on eight others of the published kind. One seed: about one point is chance."
        ),
        "",
        *_table(["", "steps", "accuracy %", "mean IoU %", "false zones / 1,000 m²"], rows),
        "",
    ]


def _again(description: dict[str, Any]) -> list[str]:
    training = description["training"]
    minutes = (training["processor_seconds_preparing"] + training["processor_seconds_training"]) / 60
    return [
        "## Make it again",
        "",
        "All of it: `make model`. Step by step:",
        "",
        "```sh",
        f"python -m slopewatch.models weights --folder DIR          # about {minutes:.0f} minutes on one core",
        "python -m slopewatch.models figures                       # the benchmark sets: about 15 minutes",
        "python -m slopewatch.models figures --residual            # about 3",
        "python -m slopewatch.models folds --recipe slopewatch --folder DIR   # about 32; paper 45; residual few",
        "python -m slopewatch.models ablation --folder DIR         # about 35",
        "python -m slopewatch.models card                          # this page",
        "```",
        "",
        (
            "Trainings and folds go on where they were broken off. Whoever replaces the weights replaces "
            "`slopewatch.json` and `slopewatch.sha256` with them. `training_log.csv` is the log of the training, "
            "`figures/` holds all scores."
        ),
        "",
    ]


def _range(values: dict[str, float]) -> str:
    return f"{100 * values['mean']:.1f} ({100 * values['lowest']:.1f} to {100 * values['highest']:.1f})"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.1f}"


def _of(recall: dict[str, Any]) -> str:
    return "" if recall["recall"] is None else f"{_percent(recall['recall'])} % of {recall['hazards']}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
