"""Motion where relief holds one direction only: how often the length holds within its errors, and the azimuth.

Simulated ridges and furrows that run in any direction, moved across and along themselves; real ground in two halves,
still and moved (``displacement_real``). Windows do not overlap by more than half.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float
from ...engine.displacement.displacement import measure_displacement
from ...engine.displacement.registered import Registered
from ...interface.parameters import DisplacementParameters
from .displacement_real import REAL, RealGround, real_pair
from .displacement_scenes import Furrows, furrowed_pair, in_space, on_the_plane
from .kept_cases import KeptCases
from .table import Row, say

FIRST_SEED, GROUNDS = 101, 30
SPACING_M = 4.0
_MOTION_M = 0.2


def rows(store: Path | None = None) -> list[Row]:
    """How honest length and azimuth are; cases that ``store`` holds are not measured again."""
    cases = KeptCases(store and store.with_suffix(".jsonl"))
    found = []
    for seed in range(FIRST_SEED, FIRST_SEED + GROUNDS):
        found += cases.get(f"furrows {seed}", partial(furrows, seed))
    say("furrows")
    table = list(_rows(f"furrows, {GROUNDS} grounds", found))
    for ground in REAL:
        if not ground.path.exists():
            continue
        maps = [cases.get(f"{ground.name} {number}", partial(real, ground, number)) for number in range(ground.maps)]
        say(ground.name)
        both = [row for found in maps for row in found]
        table += _rows(f"{ground.name}, still", [row for row in both if not row["motion"]])
        table += _rows(f"{ground.name}, moved by 5 and 20 cm", [row for row in both if row["motion"]])
    return table


def furrows(seed: int) -> list[dict[str, float]]:
    """The windows of a ground whose motion is drawn by its seed."""
    rng = np.random.default_rng((seed, 31))
    motion, points = rng.uniform(-_MOTION_M, _MOTION_M, 2), rng.uniform(30.0, 110.0)
    scene = furrowed_pair(seed, points, motion)
    return windows(scene.first, scene.later, in_space(np.append(motion, 0.0)), scene)


def real(ground: RealGround, number: int) -> list[dict[str, float]]:
    """The windows of a real ground in halves."""
    pair = real_pair(ground, number)
    return windows(pair.first, pair.later, pair.motion)


def windows(first: Float, later: Float, motion: Float, scene: Furrows | None = None) -> list[dict[str, float]]:
    """Of each window with one direction: ``amount``, its ``error`` and ``turn`` as stated; the true motion (3,)
    ``along`` the stated direction; and, of a ``scene``, in the true direction, with how far that is ``off``, radians.
    """
    found = measure_displacement(first, later, DisplacementParameters(spacing=SPACING_M), Registered.unknown())
    parts = found.components
    places = on_the_plane(found.vectors.places[parts.number])
    rows = []
    for k, direction in enumerate(parts.direction):
        row = {
            "amount": float(parts.amount[k]), "error": float(parts.error[k]), "turn": float(parts.turn[k]),
            "along": float(direction @ motion), "motion": float(np.linalg.norm(motion)), "width": float(parts.width[k]),
        }  # fmt: skip
        if scene is not None:
            angle = scene.across(places[k, :2], parts.width[k] / 2)
            true = in_space(np.array([np.cos(angle), np.sin(angle), 0.0]))
            true *= 1.0 if true @ direction >= 0 else -1.0
            row |= {"true": float(true @ motion), "off": float(np.arccos(min(true @ direction, 1.0)))}
        rows.append(row)
    return rows


def _rows(name: str, found: Sequence[Any]) -> Iterator[Row]:
    column = {key: np.array([row[key] for row in found]) for key in found[0]} if found else {}
    if not column:
        yield Row(f"{name}: windows with one direction", "0")
        return
    target = "93 to 97 %"
    for what, key in (("across the furrows", "true"), ("in the stated direction", "along")):
        if key not in column:
            continue
        score = (column["amount"] - column[key]) / column["error"]
        within = 100 * float((np.abs(score) < 2).mean())
        yield Row(
            f"{name}: motion {what} within two standard errors", f"{within:.1f} % of {len(score)}", target,
            f"errors {np.sqrt(np.mean(score**2)):.2f} of those stated", within >= 93,
        )  # fmt: skip
    if "off" in column:
        score = column["off"] / column["turn"]
        within = 100 * float((np.abs(score) < 2).mean())
        degrees = np.degrees(np.sqrt(np.mean(column["off"] ** 2)))
        yield Row(
            f"{name}: azimuth within two standard errors", f"{within:.1f} %", target,
            f"{degrees:.1f} degrees rms, {np.sqrt(np.mean(score**2)):.2f} of those stated", within >= 93,
        )  # fmt: skip
