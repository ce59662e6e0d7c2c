"""The difference of two surveys, its error, and what counts as change."""
