"""The command line under its former name, for one release: use ``python -m slopewatch.cli``."""

from ...cli import main

__all__ = ["main"]
