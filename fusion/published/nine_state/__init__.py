"""What the filters over nine states share: motion, measurements, the run that leads a filter through a drive."""
