"""``python -m slopewatch.engine.cli``, the former name."""

from ...cli import main

main()
