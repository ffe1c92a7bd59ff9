"""The stored road network: importing it, what an import takes away, which import stands."""
