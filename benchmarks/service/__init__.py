"""A real service for benchmarks: its processes, and what is uploaded to it."""
