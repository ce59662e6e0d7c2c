"""Simulated surveys of one slope with known change."""
