"""What the field of a database takes: QGIS keeps it in its history, so no password."""

from __future__ import annotations

import pytest
from qgis.core import QgsApplication, QgsProcessingContext, QgsProcessingException, QgsProcessingFeedback
from slopewatch.processing_algorithms.exportgis import ExportGis
from slopewatch.processing_algorithms.values import Values


def arguments(address: str) -> list[str]:
    algorithm = ExportGis().create()
    given = {"INPUT": "/results", "TO": address}
    return algorithm.arguments(Values(algorithm, given, QgsProcessingContext(), QgsProcessingFeedback()))


@pytest.mark.parametrize("address", ["postgresql://u@h/db", "postgresql://h:5432/db", " postgresql://u@h:5432/db "])
def test_an_address_goes_to_the_engine(qgis_app: QgsApplication, address: str) -> None:
    assert arguments(address)[-2:] == ["--to", address.strip()]


def test_without_one_there_is_no_option(qgis_app: QgsApplication) -> None:
    assert "--to" not in arguments("")


@pytest.mark.parametrize("address", ["postgresql://u:p%40@h/db", "postgresql://h/db?password=x"])
def test_a_password_is_refused(qgis_app: QgsApplication, address: str) -> None:
    with pytest.raises(QgsProcessingException, match=r"^TO holds a password, which QGIS would keep"):
        arguments(address)
