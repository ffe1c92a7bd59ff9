"""What a drive, or a trial of it, yielded, over HTTP: track, profile, estimates, measurements, its log."""
