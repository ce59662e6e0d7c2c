"""Clouds that somebody labelled: a class for every point, from a dimension of the file or from polygons."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.checksums import sha256
from ...engine.core.errors import InputError
from ...engine.core.messages import shown
from ...engine.core.progress import Progress
from ...engine.geometry.dominant_plane import apply_matrix, fit_plane, flattening_matrix
from ...engine.pointcloud.reading import read_cloud, read_dimension
from ...interface.parameters import FineTuneParameters, InputParameters
from ..configuration import CLASSES
from ..preparation.prepare import UNKNOWN
from ..preparation.suitability import Suitability, measure
from .label_polygons import LabelPolygons, label_by_polygons, read_label_polygons

Labels = NDArray[np.uint8]
EVERY_OTHER = "*"
ROUGH_SHARE, OPPOSITE_SHARE = 0.15, 0.25
"""Shares of rough and of opposite ground that are warned of; screening refuses such clouds."""
_MAX_SAMPLE_POINTS = 1_000_000


@dataclass(frozen=True)
class OwnCloud:
    """A labelled cloud: ``xyz`` (n, 3) in m, ``labels`` (n,) classes or ``UNKNOWN``, the file's SHA-256, and the
    ``density`` of its points, as the middle one of the slope's square metres has; ``polygons`` that lie on it.
    """

    path: Path
    xyz: Float
    labels: Labels
    sha256: str
    density: float
    polygons: int = 0

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def counts(self) -> dict[str, int]:
        """Points of each class, and those that are unknown."""
        count = np.bincount(self.labels, minlength=UNKNOWN + 1)
        return {**{name: int(count[k]) for k, name in enumerate(CLASSES)}, "unknown": int(count[UNKNOWN])}

    @property
    def known(self) -> NDArray[np.bool_]:
        return self.labels != UNKNOWN

    @property
    def labels_sha256(self) -> str:
        """Of the labels as they were understood, wherever they came from."""
        return hashlib.sha256(self.labels.tobytes()).hexdigest()


def class_mapping(text: str) -> dict[str, int]:
    """The class of every value, from ``2:background,20:uplift,*:unknown``; an empty text means SlopeWatch's own
    numbers. The classes' names mean themselves in either case.

    Raises:
        InputError: not of that form, or not a class.
    """
    names = {**{name: k for k, name in enumerate(CLASSES)}, "unknown": UNKNOWN}
    if not text.strip():
        return {"0": 0, "1": 1, "2": 2, str(UNKNOWN): UNKNOWN, **names}
    mapping: dict[str, int] = {}
    for part in text.split(","):
        value, colon, name = (piece.strip() for piece in part.rpartition(":"))
        if not (colon and value and name.lower() in names):
            raise InputError(
                f"classes has the part {part.strip()!r}; give value:class pairs such as 2:background,20:uplift with "
                f"the classes {', '.join(names)}."
            )
        key = value_key(value)
        if mapping.setdefault(key, names[name.lower()]) != names[name.lower()]:
            raise InputError(f"classes gives the value {value} two classes; leave one of them out.")
    return {**names, **mapping}


def value_key(value: Any) -> str:
    """A value as the mapping names it: numbers without needless decimals, words in lower case."""
    text = str(value).strip().lower()
    try:
        return f"{float(text):.12g}"
    except ValueError:
        return text


def labels_of_values(
    values: NDArray[np.generic], mapping: Mapping[str, int], name: str, dimension: str
) -> NDArray[np.uint8]:
    """(n,) classes of the values of a dimension; values that are not a number are unknown.

    Raises:
        InputError: a value that the mapping does not have.
    """
    found, inverse = np.unique(values, return_inverse=True)
    other = mapping.get(EVERY_OTHER)
    table = np.full(len(found), UNKNOWN, dtype=np.uint8)
    strange: list[str] = []
    for place, value in enumerate(found.tolist()):
        if value != value:  # not a number: no label
            continue
        label = mapping.get(value_key(value), other)
        if label is None:
            strange.append(f"{value:g}")
        else:
            table[place] = label
    if strange:
        shown_values = ", ".join(strange[:8]) + (" and more" if len(strange) > 8 else "")
        raise InputError(
            f"The dimension {dimension} of {name} has values that are no class ({shown_values}); say what they are "
            "with --classes, such as 0:background,1:uplift,2:subsidence,*:unknown."
        )
    return table[inverse.reshape(-1)]


def read_own_clouds(
    paths: Sequence[Path],
    parameters: FineTuneParameters,
    inputs: InputParameters,
    polygons: Path | None,
    progress: Progress,
) -> list[OwnCloud]:
    """Read labelled clouds.

    Raises:
        InputError: a cloud cannot be read; the dimension or the field is missing; a value is no class; no point of a
            cloud has a label; all have one class; a cloud is there twice; the polygons lie outside of all clouds.
    """
    if not paths:
        raise InputError("There is no cloud to train on; give one or more labelled LAS or LAZ files.")
    areas = None
    mapping = class_mapping(parameters.classes)
    if polygons is None:
        plain = parameters.dimension.lower() == "classification"
        if plain and not parameters.classes.strip():
            raise InputError(
                "The values of Classification are not SlopeWatch's classes; say what they are with --classes, such as "
                "2:background,20:uplift,21:subsidence,*:unknown."
            )
    else:
        areas = read_label_polygons(polygons, parameters.class_field, mapping, value_key)
    clouds = []
    for number, path in enumerate(paths):
        with progress.stage(number / len(paths), (number + 1) / len(paths), f"reading {shown(path)}"):
            clouds.append(_read(path, parameters, inputs, mapping, areas, progress))
    _refuse_useless(clouds, areas, progress)
    return clouds


def _read(
    path: Path,
    parameters: FineTuneParameters,
    inputs: InputParameters,
    mapping: Mapping[str, int],
    areas: LabelPolygons | None,
    progress: Progress,
) -> OwnCloud:
    cloud = read_cloud(path, inputs, classification=False, progress=progress)
    touching = 0
    if areas is None:
        values = read_dimension(path, parameters.dimension)
        labels = labels_of_values(values, mapping, shown(path), parameters.dimension)
    else:
        outside = 0 if parameters.outside == "background" else UNKNOWN
        labels, touching = label_by_polygons(cloud, areas, outside, inputs, progress)
    facts = slope_facts(cloud.xyz)
    if facts is not None:
        _warn_of_other_ground(facts, shown(path), progress)
    density = facts.density if facts else float(len(cloud))
    return OwnCloud(Path(path), cloud.xyz, labels, sha256(Path(path)), density, touching)


def _refuse_useless(clouds: Sequence[OwnCloud], areas: LabelPolygons | None, progress: Progress) -> None:
    if areas is not None and not any(cloud.polygons for cloud in clouds):
        raise InputError(
            f"No polygon of {shown(areas.path)} lies on any of the clouds; check the polygons and the reference "
            "systems."
        )
    seen: dict[str, OwnCloud] = {}
    for cloud in clouds:
        twin = seen.setdefault(cloud.sha256, cloud)
        if twin is not cloud:
            raise InputError(
                f"{shown(twin.path)} and {shown(cloud.path)} are the same cloud, and a model scored on what it was "
                "trained on says nothing; give each once."
            )
        if not cloud.known.any():
            raise InputError(f"{shown(cloud.path)} has no labelled point; label some or leave the file out.")
    total = {name: sum(cloud.counts[name] for cloud in clouds) for name in CLASSES}
    there = [name for name, count in total.items() if count]
    if len(there) < 2:
        raise InputError(
            f"All labelled points are {there[0]}, and there is nothing to distinguish; give clouds with at least two "
            f"of {', '.join(CLASSES)}."
        )
    for name in CLASSES:
        if not total[name]:
            progress.warning(f"No point is labelled {name}; the model will forget what that looks like.")


def slope_facts(xyz: Float) -> Suitability | None:
    """What screening would look at before it takes such a cloud (see ``preparation.suitability``); None for a few
    points.
    """
    every = max(1, len(xyz) // _MAX_SAMPLE_POINTS)
    sample = xyz[::every]
    if len(sample) < 50:
        return None
    plane = fit_plane(sample, 1.0, 64, 0)
    return measure(sample, apply_matrix(flattening_matrix(plane), sample), plane, float(every))


def _warn_of_other_ground(facts: Suitability, name: str, progress: Progress) -> None:
    if facts.rough_share > ROUGH_SHARE:
        progress.warning(
            f"{name} scatters as plants do ({100 * facts.rough_share:.0f} % of its square metres), but models screen "
            "ground points; extract them first (slopewatch ground)."
        )
    if facts.opposite_share > OPPOSITE_SHARE:
        progress.warning(f"{name} has two opposite faces, but models screen one slope at a time; give each by itself.")
