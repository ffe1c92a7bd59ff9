"""OGC API Features: its documents in every form that is asked for, and the routes to them. ``app.map.items`` answers."""
