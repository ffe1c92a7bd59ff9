"""What is drawn of roads from afar: pieces of several segments, fewer and coarser from level to level."""
