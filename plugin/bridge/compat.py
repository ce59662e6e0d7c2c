"""The enumerations that moved between QGIS 3.34 and 4, under one name."""

from __future__ import annotations

from typing import Any

from qgis.core import (
    Qgis,
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingParameterDateTime,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFile,
    QgsProcessingParameterNumber,
)
from qgis.PyQt.QtCore import QMetaType, QVariant


def _member(new: str, new_member: str, owner: type, old: str, old_member: str) -> Any:
    """``Qgis.<new>.<new_member>`` (QGIS 3.36 and later), else ``<owner>.<old>.<old_member>``."""
    enumeration = getattr(Qgis, new, None)
    if enumeration is not None:
        return getattr(enumeration, new_member)
    return getattr(getattr(owner, old), old_member)


# name here: (enumeration of Qgis, its member, class before QGIS 3.36, its enumeration, its member)
_NAMES: dict[str, tuple[str, str, type, str, str]] = {
    "INTEGER": ("ProcessingNumberParameterType", "Integer", QgsProcessingParameterNumber, "Type", "Integer"),
    "DOUBLE": ("ProcessingNumberParameterType", "Double", QgsProcessingParameterNumber, "Type", "Double"),
    "ADVANCED": ("ProcessingParameterFlag", "Advanced", QgsProcessingParameterDefinition, "Flag", "FlagAdvanced"),
    "OPTIONAL": ("ProcessingParameterFlag", "Optional", QgsProcessingParameterDefinition, "Flag", "FlagOptional"),
    "POLYGON": ("ProcessingSourceType", "VectorPolygon", QgsProcessing, "SourceType", "TypeVectorPolygon"),
    "LINE": ("ProcessingSourceType", "VectorLine", QgsProcessing, "SourceType", "TypeVectorLine"),
    "ANY_SHAPE": ("ProcessingSourceType", "VectorAnyGeometry", QgsProcessing, "SourceType", "TypeVectorAnyGeometry"),
    "RASTER": ("ProcessingSourceType", "Raster", QgsProcessing, "SourceType", "TypeRaster"),
    "FILE": ("ProcessingFileParameterBehavior", "File", QgsProcessingParameterFile, "Behavior", "File"),
    "FOLDER": ("ProcessingFileParameterBehavior", "Folder", QgsProcessingParameterFile, "Behavior", "Folder"),
    "FILES": ("ProcessingSourceType", "File", QgsProcessing, "SourceType", "TypeFile"),
    "NO_THREADING": (
        "ProcessingAlgorithmFlag",
        "NoThreading",
        QgsProcessingAlgorithm,
        "Flag",
        "FlagNoThreading",
    ),
    "DATE": ("ProcessingDateTimeParameterDataType", "Date", QgsProcessingParameterDateTime, "Type", "Date"),
}

INTEGER = _member(*_NAMES["INTEGER"])
DOUBLE = _member(*_NAMES["DOUBLE"])
ADVANCED = _member(*_NAMES["ADVANCED"])
OPTIONAL = _member(*_NAMES["OPTIONAL"])
POLYGON = _member(*_NAMES["POLYGON"])
LINE = _member(*_NAMES["LINE"])
ANY_SHAPE = _member(*_NAMES["ANY_SHAPE"])
RASTER = _member(*_NAMES["RASTER"])
FILE = _member(*_NAMES["FILE"])
FOLDER = _member(*_NAMES["FOLDER"])
FILES = _member(*_NAMES["FILES"])
NO_THREADING = _member(*_NAMES["NO_THREADING"])
DATE = _member(*_NAMES["DATE"])
STRING = QMetaType.Type.QString if Qgis.QGIS_VERSION_INT >= 33800 else QVariant.String
"""Kind of a field of text."""
