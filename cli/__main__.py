"""``python -m slopewatch.engine.cli``."""

from . import main

main()
