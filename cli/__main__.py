"""``python -m slopewatch.cli``."""

from . import main

main()
