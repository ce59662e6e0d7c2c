"""The version of SlopeWatch; metadata.txt and pyproject.toml carry the same."""

VERSION = "0.1.0"
