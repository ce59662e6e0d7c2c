"""Fixtures of the tests inside QGIS's interpreter."""

from slopewatch.tests.builders.qgis import fake_engine, feedback, provider, qgis_process, survey

__all__ = ["fake_engine", "feedback", "provider", "qgis_process", "survey"]
