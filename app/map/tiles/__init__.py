"""Vector tiles: what they are made of, where they are kept, how it is known that they are new, and who may ask."""
