"""OGC API Features: its documents in every form, and the routes to them. ``app.map.items`` finds the items."""
