"""What the sensors of a simulated vehicle read."""
