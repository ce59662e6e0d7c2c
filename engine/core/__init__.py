"""Errors, progress, cancelling, child processes, staged outputs, run record. Imports nothing of the engine."""
