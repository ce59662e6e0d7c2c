"""Measurements: ``python -m slopewatch.lab`` prints SlopeWatch's figures compared with those of peers."""
