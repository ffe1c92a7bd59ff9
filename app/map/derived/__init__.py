"""What is derived from segments, and how it follows their changes."""
