"""The job queue: what a task is, how a worker runs them, and what becomes of one that is cut off. Knows no subject."""
