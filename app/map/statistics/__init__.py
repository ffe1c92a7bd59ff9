"""What is counted of the map as a whole, by workers, beside the requests: figures, growth, stored tiles."""
