"""The laboratory: what made and checks the figures. It is shipped nowhere, and nothing outside imports it."""
