"""Regions and rasters over HTTP, and the operator's long work: imports, removals, settling, as jobs of the queue."""
