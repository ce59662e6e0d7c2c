"""Names of what a batch writes of all slopes together, and of the slopes' tables that it is made of."""

from __future__ import annotations

GEOPACKAGE, PARQUET, MOSAIC, CATALOGUE, PAGE, PAGE_PDF = (
    "corridor.gpkg",
    "corridor.parquet",
    "elevation_change.vrt",
    "clouds.vpc",
    "corridor.html",
    "corridor.pdf",
)
MOSAIC_STYLE = "elevation_change.qml"
BATCH_OUTPUTS = (GEOPACKAGE, PARQUET, MOSAIC, MOSAIC_STYLE, CATALOGUE, PAGE, PAGE_PDF, "run.json")
SOURCES = (("zones", "change"), ("series_zones", "series"), ("screened_zones", "screening"))
"""Key of an output of a slope with a layer of zones, and the word for it."""
