"""Parameters of what is drawn on and drawn: the top view, a proposed region, pictures for labelling."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class TopViewParameters(ParameterSet, record_name="top_view"):
    """Top view: a raw cloud as rasters to draw on."""

    cell: float | str = _parameter(
        AUTO,
        "Cell size",
        "Side of a cell of all rasters. Larger has fewer empty cells and steadier densities, smaller is sharper. auto: "
        "about twice the point spacing (0.05, 0.1, 0.2, 0.5, 1, 2 or 5 m), larger where the memory would not do.",
        kind=float,
        unit="m",
        bounds=(0.005, 100.0),
    )
    hillshade: str = _parameter(
        "lowest",
        "Hillshade of",
        "lowest: the lowest return of each cell and the eight around it, which shows the form of the ground where "
        "pulses get through the plants: scars, benches, ditches. highest: the highest return, which shows plants and "
        "structures.",
        choices=("lowest", "highest"),
    )
    ground_returns: str = _parameter(
        "auto",
        "Ground returns",
        "What counts for ground density and canopy height. class_2: points of that class. estimate: returns close to a "
        "quick surface through the lowest ones, which is no ground extraction. auto: class_2 where the cloud has such "
        "points, else estimate.",
        choices=("auto", "class_2", "estimate"),
    )
    detail: float | str = _parameter(
        AUTO,
        "Distance of the points that will do",
        "Of a COPC only the coarser levels are read, down to points about so far apart: a quick picture, hillshade "
        "and canopy height of a large cloud, without densities. Smaller reads more. Other files are read as a whole. "
        "auto: all points.",
        kind=float,
        unit="m",
        bounds=(0.001, 100.0),
        advanced=True,
    )
    view_memory: float = _parameter(
        2.0,
        "Memory for the rasters",
        "A cell left to the cloud becomes larger where the rasters would need more, a cell that is given is refused. "
        "Larger allows smaller cells on larger areas.",
        unit="GB",
        bounds=(0.5, 1024.0),
        advanced=True,
    )


@dataclass(frozen=True)
class RegionParameters(ParameterSet, record_name="region"):
    """Proposal of a region of interest: what of a cloud is dense and whole enough to be inspected."""

    region_cell: float | str = _parameter(
        AUTO,
        "Cell of the density",
        "Side of the squares in which points are counted; outlines are about as exact. Larger is steadier, smaller "
        "follows the edge more closely. auto: about five times the point spacing (0.2, 0.5, 1, 2, 5 or 10 m).",
        kind=float,
        unit="m",
        bounds=(0.05, 100.0),
    )
    least_density: float = _parameter(
        0.4,
        "Least density",
        "Share of the cloud's own density (half of its points lie in denser places) below which a place is too sparse. "
        "Larger cuts more of the edges. Smaller is needed where a part is much denser than the rest, as a cliff is.",
        bounds=(0.01, 1.0),
    )
    largest_hole: float = _parameter(
        25.0,
        "Largest hole that is filled",
        "Sparse or empty places within the region up to this area belong to it; larger ones are left out. Larger fills "
        "more.",
        unit="m²",
        bounds=(0.0, 1e6),
    )
    spike_width: float = _parameter(
        3.0,
        "Width of spikes",
        "Parts of the outline and bridges narrower than this are removed. Larger gives a rounder region.",
        unit="m",
        bounds=(0.0, 1000.0),
    )
    smallest_part: float = _parameter(
        0.05,
        "Smallest part",
        "Parts smaller than this share of the largest one are left out. Larger leaves fewer parts; 1 only the largest.",
        bounds=(0.0, 1.0),
    )
    simplification: float | str = _parameter(
        AUTO,
        "Simplification",
        "Distance by which the outline may leave the edges of the squares. Larger has fewer corners. auto: the side of "
        "a square.",
        kind=float,
        unit="m",
        bounds=(0.001, 100.0),
        advanced=True,
    )


@dataclass(frozen=True)
class LabellingParameters(ParameterSet, record_name="labelling"):
    """Pictures and tasks for Label Studio."""

    labels: str = _parameter(
        "uplift,subsidence,background,unknown",
        "Labels",
        "Names that are offered for what is drawn, separated by commas. Those of the default are the classes that "
        "Train a model understands.",
    )
    label_field: str = _parameter(
        "kind",
        "Field with the label",
        "Field of the given segments that becomes their label in Label Studio; kind is that of SlopeWatch's zones. "
        "Values that are not among the labels are offered, too.",
    )
    picture_address: str = _parameter(
        "/data/local-files/?d=",
        "Address of the pictures",
        "Put before the name of a picture in the tasks: where Label Studio finds it. That of the default is its local "
        "storage, whose root is the folder of the pictures.",
        advanced=True,
    )
    largest_picture: int = _parameter(
        4096,
        "Largest picture",
        "Pixels along the side of a picture; a larger top view becomes several tasks. Larger needs more memory in the "
        "browser.",
        unit="px",
        bounds=(256, 16384),
        advanced=True,
    )
