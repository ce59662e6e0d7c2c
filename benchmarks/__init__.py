"""Side-by-side measurements: ``python -m slopewatch.benchmarks`` prints SlopeWatch's figures with the peers' beside."""
