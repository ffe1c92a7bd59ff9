"""The stored road network: reading it, importing it, what an import takes away."""
