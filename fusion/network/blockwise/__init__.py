"""A network's equations in blocks, after Helmert: interiors are eliminated onto borders, borders along a tree.

Each block eliminates the unknowns that occur in its equations alone; what is left speaks of its border. A border is
eliminated at the lowest node of the tree below which all of its equations are, so no node has a large system. The way
back down hands solution and covariances of borders on, exactly as if all had been solved at once.
"""
