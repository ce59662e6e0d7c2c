"""Measurements: ``python -m slopewatch.benchmarks`` prints SlopeWatch's figures compared with those of peers."""
