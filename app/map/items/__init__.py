"""The engine of items: what can be asked of segments and ways, and pages of them as GeoJSON that PostgreSQL writes."""
