"""Between QGIS and the engine: client, interpreter, settings, styling."""
