"""What a method has to beat: a line through raw altitudes, the terrain's own heights."""
