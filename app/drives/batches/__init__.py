"""Many drives processed again at once: chosen, queued piece by piece, followed, cancelled."""
