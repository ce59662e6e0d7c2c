"""What QGIS sees besides the algorithms. Imports only qgis, the standard library and ``interface``."""
