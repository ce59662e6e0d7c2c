"""Builds the engine's environment in the user's data folder, from the plugin's zip alone. Standard library only."""
