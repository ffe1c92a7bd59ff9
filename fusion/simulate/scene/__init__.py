"""Where a simulated drive takes place: terrain, streets, heights, and the town that they make. Data, no files."""
