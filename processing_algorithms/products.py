"""The products of a change: the output folder, and each raster and vector as a destination of its own.

The engine writes all products under fixed names into the output folder. A destination that is left temporary is that
very file; one that is given another path becomes a copy, so that models and batches can chain on it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterVectorDestination,
    QgsProcessingUtils,
)

from ..plugin.bridge.compat import POLYGON
from ..plugin.bridge.elevation_layers import surfaces
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance, copy_raster, copy_vector, leave_unloaded, style_on_completion
from .declare import MORE, PLACE, in_group, with_help
from .values import Values


@dataclass(frozen=True)
class Product:
    """A destination: its ``name`` in Processing, the engine's ``key``, and how it is loaded."""

    name: str
    key: str
    label: str
    help: str
    appearance: Appearance
    layer: str = ""  # of a GeoPackage; empty for a raster
    by_default: bool = True
    file: str = ""  # name in the output folder, where it is not that of the key

    @property
    def file_name(self) -> str:
        return self.file or f"{self.key}.{'gpkg' if self.layer else 'tif'}"


CHANGE_FOLDER = "Receives the rasters, hazard zones, heatmap, report and run record under fixed names."
CLASSES = Product(
    "CLASS_BUDGET",
    "classes",
    "Change by class of asset",
    "Polygons of the classes with areas, volumes and errors of their change; written only with a layer of classes.",
    Appearance(47, visible=False, expanded=False),
    layer="budget_by_class",
    by_default=False,
    file="budget_by_class.gpkg",
)
CHANGE_PRODUCTS = (
    Product(
        "ZONES",
        "zones",
        "Hazard zones",
        "Polygons of contiguous significant change with area, heights, volumes and severity.",
        Appearance(50),
        layer="zones",
    ),
    Product(
        "FOOTPRINTS",
        "zones",
        "Footprints of the volumes",
        "Polygons over which the zones' volumes are taken, which reach beyond the significant cells.",
        Appearance(45, visible=False, expanded=False),
        layer="footprints",
    ),
    Product(
        "OBJECTS",
        "objects",
        "Objects above the ground",
        "Polygons of boulders, walls, vehicles, heaps and vegetation that appeared or vanished; written only for "
        "clouds that have all their returns.",
        Appearance(52),
        layer="objects",
    ),
    Product(
        "UNSURE",
        "zones",
        "Unsure change",
        "Polygons of change beyond the level of detection that is no zone, with its mean, its error and the reason; no "
        "area and no volume counts it.",
        Appearance(44, visible=False, expanded=False),
        layer="unsure",
    ),
    Product(
        "NOT_SEEN",
        "zones",
        "Not seen",
        "Polygons of the slope that was not compared, hatched, with the reason.",
        Appearance(42),
        layer="not_seen",
    ),
    Product(
        "SIGNIFICANT_CHANGE",
        "significant_change",
        "Significant change (m)",
        "Elevation change where it is above the level of detection; no data elsewhere.",
        Appearance(40),
    ),
    Product(
        "ELEVATION_CHANGE",
        "elevation_change",
        "Elevation change (m)",
        "Height of the later survey minus that of the reference in each cell, also where it is within its error.",
        Appearance(30, visible=False, expanded=False),
    ),
    Product(
        "SEEN",
        "seen",
        "Seen and not seen",
        "Class of each cell of the slope: compared, or why not (no ground in a survey, too few points, excluded).",
        Appearance(38, visible=False, expanded=False),
    ),
    Product(
        "LEVEL_OF_DETECTION",
        "level_of_detection",
        "Level of detection (m)",
        "Smallest change of a cell that can be distinguished from noise, at the chosen confidence.",
        Appearance(20, visible=False, expanded=False),
        by_default=False,
    ),
    Product(
        "CHANGE_PROBABILITY",
        "change_probability",
        "Probability of change",
        "Probability that a cell's change is real, from the cell and those around it; written only with the threshold "
        "coherent.",
        Appearance(19, visible=False, expanded=False),
        by_default=False,
    ),
    Product(
        "CELL_SIZE",
        "cell_size",
        "Size of the cells (m)",
        "Side of the cell that each place was compared in; written only where cells grow.",
        Appearance(18, visible=False, expanded=False),
        by_default=False,
    ),
    Product(
        "PLANT_ERROR",
        "plant_error",
        "Error by plants (m)",
        "Standard error that plants make of each cell's change; written only where the ground records plants.",
        Appearance(17, visible=False, expanded=False),
        by_default=False,
    ),
    Product(
        "PLANT_CHANGE",
        "plant_change",
        "Change that plants explain (m)",
        "Change beyond the level of detection that no zone and no volume counts, because the plants differ as much; "
        "written only where there is any.",
        Appearance(16, visible=False, expanded=False),
        by_default=False,
    ),
    Product(
        "HEATMAP",
        "heatmap_raster",
        "Heatmap",
        "Elevation change half-transparent over the top view, as a coloured GeoTIFF.",
        Appearance(15, visible=False, expanded=False),
        by_default=False,
        file="heatmap.tif",
    ),
    Product(
        "TOP_VIEW",
        "top_view",
        "Top view",
        "Orthographic picture of the later cloud from above, in its colours or intensity.",
        Appearance(10, expanded=False),
    ),
    Product(
        "SURFACE_HEIGHTS",
        "surface_heights",
        "Heights of both surfaces (m)",
        "Height of the ground in each cell: the first band is the earlier survey, the second the later one. Loaded as "
        "two elevation layers, for elevation profiles and 3D views.",
        Appearance(
            8,
            visible=False,
            expanded=False,
            after=surfaces(("Ground heights, earlier survey (m)", "Ground heights, later survey (m)")),
        ),
    ),
    Product(
        "POINT_COUNTS",
        "point_counts",
        "Ground points in each cell",
        "Number of ground points in each cell: the first band is the earlier survey, the second the later one.",
        Appearance(7, visible=False, expanded=False),
        by_default=False,
    ),
    CLASSES,
)

SCREENED_PRODUCTS = (
    Product(
        "SCREENED_ZONES",
        "screened_zones",
        "Screened zones",
        "Polygons where the last survey's ground looks raised or lowered by its shape, and whether the change confirms "
        "it.",
        Appearance(48, visible=False),
        layer="zones",
    ),
    Product(
        "SCREENED_PROBABILITY",
        "screened_probability",
        "Probability of a hazard (screening)",
        "Raster whose bands are the probabilities of a hazard, of uplift and of subsidence by the last survey's shape.",
        Appearance(28, visible=False, expanded=False),
        by_default=False,
    ),
    Product(
        "SCREENED_SMALLEST_HAZARD",
        "screened_smallest_hazard",
        "Smallest hazard (m, screening)",
        "Raster of the height that a hazard needs to be found by the last survey's shape in 7 of 10 cases; its bands "
        "are for hazards 2, 3, 5 and 8 m wide.",
        Appearance(27, visible=False, expanded=False),
        by_default=False,
    ),
)


MOTION_PRODUCTS = (
    Product(
        "VECTORS",
        "displacement_vectors",
        "Displacement vectors",
        "Arrows of significant motion, drawn longer than they are, with the ellipse of their error.",
        Appearance(60),
        layer="vectors",
        file="displacement.gpkg",
    ),
    Product(
        "MOVING_ZONES",
        "displacement_vectors",
        "Zones of coherent motion",
        "Polygons of ground that moves as one, with its vector, its error and its direction against the dip.",
        Appearance(62),
        layer="zones",
        file="displacement.gpkg",
    ),
    Product(
        "ONE_DIRECTION",
        "displacement_vectors",
        "Motion known in one direction",
        "Arrows where relief holds one direction only; across them nothing is known.",
        Appearance(40, visible=False, expanded=False),
        layer="one_direction",
        file="displacement.gpkg",
    ),
    Product(
        "DISPLACEMENT",
        "displacement",
        "Displacement (m)",
        "Motion along the surface with its standard errors, and the reason where none can be given.",
        Appearance(30, visible=False, expanded=False),
    ),
    Product(
        "SMALLEST_MOTION",
        "smallest_motion",
        "Smallest motion that can be told (m)",
        "Three standard errors of the motion along the surface, also where nothing moved.",
        Appearance(20, visible=False, expanded=False),
    ),
)


def declare_folder(algorithm: QgsProcessingAlgorithm, text: str) -> None:
    algorithm.addParameter(with_help(QgsProcessingParameterFolderDestination("OUTPUT_FOLDER", "Output folder"), text))


def declare_products(
    algorithm: QgsProcessingAlgorithm,
    products: tuple[Product, ...],
    place: str = "it is the file in the output folder; another path gets a copy",
) -> None:
    """Declare each product as a destination; ``place`` says where one is that is left temporary."""
    for product in products:
        note = f" Left temporary, {place}."
        if product.layer:
            parameter = QgsProcessingParameterVectorDestination(
                product.name, product.label, POLYGON, None, True, product.by_default
            )
        else:
            parameter = QgsProcessingParameterRasterDestination(
                product.name, product.label, None, True, product.by_default
            )
        in_folder = algorithm.parameterDefinition("OUTPUT_FOLDER") is not None
        shown = f"{product.file_name} in the output folder" if in_folder else place.replace("it lies ", "")
        in_group(with_help(parameter, product.help + note), f"[{shown}]", more=PLACE)
        algorithm.addParameter(in_group(parameter, "" if product.by_default else "yes", more=MORE))


def vector_destination(name: str, label: str, text: str) -> QgsProcessingParameterVectorDestination:
    """A GeoPackage of polygons that the engine writes where it is wanted."""
    return with_help(QgsProcessingParameterVectorDestination(name, label, POLYGON), f"{text} A GeoPackage (.gpkg).")


def deliver(
    products: tuple[Product, ...], result: EngineResult, values: Values, group: str, empty: tuple[str, ...] = ()
) -> dict[str, Any]:
    """The products as results: the folder's files, or copies where a destination asks for one; loaded with style.

    Those named in ``empty`` are results, too, but are not loaded where their destination is left temporary.
    """
    results: dict[str, Any] = {}
    for product in products:
        source = result.outputs.get(product.key, "")
        if not source:
            continue
        wanted = values.algorithm.parameterAsOutputLayer(values.parameters, product.name, values.context)
        path = source
        if wanted and not is_temporary(wanted) and os.path.realpath(wanted) != os.path.realpath(source):
            path = os.path.abspath(wanted)
            if product.layer:
                copy_vector(source, path, product.layer, values.context)
            else:
                copy_raster(source, path)
        results[product.name] = path
        if product.name in empty and wanted and is_temporary(wanted):
            leave_unloaded(values.context, wanted)
            continue
        own_name = getattr(values.parameters.get(product.name), "destinationName", "")
        # Without its name the layer of a GeoPackage does not find its style.
        layer = f"{path}|layername={product.layer}" if path.endswith(".gpkg") else path
        style_on_completion(values.context, wanted, layer, product.appearance, "" if own_name else product.label, group)
    return results


def is_temporary(path: str) -> bool:
    """Whether QGIS will remove the file when it ends."""
    folder, real = os.path.realpath(QgsProcessingUtils.tempFolder()), os.path.realpath(path)
    return real == folder or real.startswith(folder + os.sep)
