"""The model card: what the shipped weights are, what they were measured at, what they must not be used for.

Every figure comes from the description of the weights and the scores next to them; the text states no number itself.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...engine.core.templates import render
from ...models.configuration import CLASSES

SETS = ("published", "realistic", "shifted")
RECIPES = {"slopewatch": "SlopeWatch", "paper": "published pipeline", "residual": "threshold on the residual"}
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "model_card.md.j2"


def read_figures(folder: Path) -> dict[str, Any]:
    """All scores that are kept next to the weights, by file name without its ending."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))}


def model_card(
    description: dict[str, Any],
    figures: dict[str, Any],
    seconds: dict[str, Sequence[float]],
    relief: dict[str, Any] | None = None,
) -> str:
    """The card as Markdown.

    Args:
        description: of the weights (``weights.ModelFile.metadata``).
        figures: as ``read_figures`` gives them; a table is left out where its scores are not there.
        seconds: by recipe, the processor's seconds that a fold was trained in, on average, and scored in.
        relief: description of the weights of the network on relief, whose part is left out without.
    """
    shipped = {name: figures[f"{name}_slopewatch"] for name in SETS if f"{name}_slopewatch" in figures}
    return render(
        _TEMPLATE,
        classes=CLASSES,
        description=description,
        relief=relief,
        folds=[
            (name, figures[f"folds_{recipe}"], seconds.get(recipe))
            for recipe, name in RECIPES.items()
            if f"folds_{recipe}" in figures
        ],
        sets=[
            (name, model, figures[f"{name}_{recipe}"])
            for name in SETS
            for recipe, model in (("slopewatch", "shipped"), ("residual", "threshold"))
            if f"{name}_{recipe}" in figures
        ],
        shipped=shipped,
        negatives=sorted({kind for scores in shipped.values() for kind in scores["wrong_share_by_negative"]}),
        ablation=figures.get("ablation"),
    )


def read_seconds(folder: Path) -> tuple[float, float]:
    """Mean seconds of training and of scoring over the folds in a folder of ``folds.score_folds``."""
    rows = []
    for path in sorted(folder.glob("fold_*/seconds.csv")):
        with path.open(encoding="utf-8") as file:
            row = next(csv.DictReader(file))
        rows.append((float(row["training_s"]), float(row["scoring_s"])))
    return sum(r[0] for r in rows) / len(rows), sum(r[1] for r in rows) / len(rows)
