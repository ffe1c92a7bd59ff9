"""A real service for benchmarks: its processes, what is uploaded to it, who asks it, how fast it answers."""
