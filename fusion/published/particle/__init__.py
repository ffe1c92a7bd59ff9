"""Method ``particle``: Al Assaad 2020, a cloud of particles in compiled loops, or its Kalman filters."""
