"""Commands of an operator that keep a service whole: its store, its backups, its elevation, its state."""
