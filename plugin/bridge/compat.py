"""The enumerations that moved between QGIS 3.34 and 4, under one name."""

from __future__ import annotations

from typing import Any

from qgis.core import (
    Qgis,
    QgsProcessing,
    QgsProcessingParameterDateTime,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFile,
    QgsProcessingParameterNumber,
)


def _member(new: str, new_member: str, owner: type, old: str, old_member: str) -> Any:
    """``Qgis.<new>.<new_member>`` (QGIS 3.36 and later), else ``<owner>.<old>.<old_member>``."""
    enumeration = getattr(Qgis, new, None)
    if enumeration is not None:
        return getattr(enumeration, new_member)
    return getattr(getattr(owner, old), old_member)


INTEGER = _member("ProcessingNumberParameterType", "Integer", QgsProcessingParameterNumber, "Type", "Integer")
DOUBLE = _member("ProcessingNumberParameterType", "Double", QgsProcessingParameterNumber, "Type", "Double")
ADVANCED = _member("ProcessingParameterFlag", "Advanced", QgsProcessingParameterDefinition, "Flag", "FlagAdvanced")
POLYGON = _member("ProcessingSourceType", "VectorPolygon", QgsProcessing, "SourceType", "TypeVectorPolygon")
LINE = _member("ProcessingSourceType", "VectorLine", QgsProcessing, "SourceType", "TypeVectorLine")
FILE = _member("ProcessingFileParameterBehavior", "File", QgsProcessingParameterFile, "Behavior", "File")
FOLDER = _member("ProcessingFileParameterBehavior", "Folder", QgsProcessingParameterFile, "Behavior", "Folder")
FILES = _member("ProcessingSourceType", "File", QgsProcessing, "SourceType", "TypeFile")
DATE = _member("ProcessingDateTimeParameterDataType", "Date", QgsProcessingParameterDateTime, "Type", "Date")
