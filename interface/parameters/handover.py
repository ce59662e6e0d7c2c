"""Parameters of what is handed over to other systems."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter

HANDOVER_FORMATS = (
    "cog", "gpkg", "geojson", "kml", "csv", "dxf", "landxml", "styles", "iso", "stac", "report", "copc",
)  # fmt: skip
"""What can be handed over; all but the last unless it is chosen."""


@dataclass(frozen=True)
class HandoverParameters(ParameterSet, record_name="handover", title="Hand over"):
    """Which files are written of a finished run, what their metadata say, and where a database keeps it."""

    formats: str = _parameter(
        ",".join(HANDOVER_FORMATS[:-1]),
        "Formats",
        "What is written, separated by commas: cog (rasters), gpkg, geojson, kml and csv (layers), dxf and landxml "
        "(zones, sections and ground), styles (QML and SLD), iso (metadata), stac (catalogue item), report, copc "
        "(clouds).",
    )
    each_slope: bool = _parameter(
        True,
        "With each slope of a corridor",
        "Of a corridor, also hands over the results of each of its slopes, in a folder of its own. Off: only what all "
        "slopes show together, which is smaller.",
    )
    surface_points: int = _parameter(
        10_000,
        "Points of a ground surface",
        "Most points of each triangle mesh in DXF and LandXML; the raster is thinned evenly until they do. Larger "
        "follows the ground more closely and makes larger files.",
        bounds=(100, 2_000_000),
    )
    metadata_title: str = _parameter(
        "",
        "Title",
        "Title in the metadata. Empty: the folder's name, what was measured and the days of the surveys.",
    )
    organisation: str = _parameter(
        "",
        "Organisation",
        "Who answers for the data, in the metadata. Empty: not stated there.",
    )
    email: str = _parameter(
        "", "E-mail address", "Of the organisation, in the metadata. Empty: left out.", advanced=True
    )
    licence: str = _parameter(
        "",
        "Conditions of use",
        "Licence or other conditions, in the metadata. Empty: it says that none are stated.",
        advanced=True,
    )
    schema: str = _parameter(
        "slopewatch",
        "Schema of the database",
        "Where a database keeps zones, events and their history; it is made at the first hand-over.",
        advanced=True,
    )
    srid: int = _parameter(
        0,
        "EPSG code in the database",
        "Reference system of a schema that is made, such as 27700; what comes later is transformed to it. 0: that of "
        "the results.",
        bounds=(0, 998_999),
        advanced=True,
    )
