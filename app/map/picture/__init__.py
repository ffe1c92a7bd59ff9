"""A picture of the map: roads on paper, with colour, key, scale and names of streets."""
