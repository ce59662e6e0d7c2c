"""``python -m slopewatch.models``: how the shipped weights and their figures are made again."""

from .making.__main__ import main

main()
