"""Archives of years of rides: which files are in them, and of each whether it is a drive on roads, or why not."""
