"""The plug-in for QGIS: its sources (``plugin``), the zip that they make, and the routes that offer it."""
