"""Al Assaad 2020: the drive of chapters 2 and 3, and how fast the particle filter is beside other code and filters."""
