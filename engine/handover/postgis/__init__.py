"""Zones, events and their history in a schema of a PostgreSQL database with PostGIS."""
