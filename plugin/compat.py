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


def _member(new: str, new_member: str, owner: type, old: str, old_member: str) -> Any:
    """``Qgis.<new>.<new_member>`` (QGIS 3.36 and later), else ``<owner>.<old>.<old_member>``."""
    enumeration = getattr(Qgis, new, None)
    if enumeration is not None:
        return getattr(enumeration, new_member)
    return getattr(getattr(owner, old), old_member)


_NUMBER = ("ProcessingNumberParameterType", QgsProcessingParameterNumber, "Type")
INTEGER = _member(_NUMBER[0], "Integer", _NUMBER[1], _NUMBER[2], "Integer")
DOUBLE = _member(_NUMBER[0], "Double", _NUMBER[1], _NUMBER[2], "Double")

ADVANCED = _member("ProcessingParameterFlag", "Advanced", QgsProcessingParameterDefinition, "Flag", "FlagAdvanced")
OPTIONAL = _member("ProcessingParameterFlag", "Optional", QgsProcessingParameterDefinition, "Flag", "FlagOptional")

POLYGON = _member("ProcessingSourceType", "VectorPolygon", QgsProcessing, "SourceType", "TypeVectorPolygon")

FILE = _member("ProcessingFileParameterBehavior", "File", QgsProcessingParameterFile, "Behavior", "File")

DATE = _member("ProcessingDateTimeParameterDataType", "Date", QgsProcessingParameterDateTime, "Type", "Date")

CAN_CANCEL = _member("ProcessingAlgorithmFlag", "CanCancel", QgsProcessingAlgorithm, "Flag", "FlagCanCancel")
