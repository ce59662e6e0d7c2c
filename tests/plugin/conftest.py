"""Fixtures of the tests inside QGIS's interpreter."""

from slopewatch.tests.qgis_support import fake_engine, feedback, provider, qgis_process

__all__ = ["fake_engine", "feedback", "provider", "qgis_process"]
