"""The stored elevation rasters."""
