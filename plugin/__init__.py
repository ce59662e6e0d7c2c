"""What QGIS sees in addition to the algorithms. Imports only qgis, the standard library and ``interface``."""
