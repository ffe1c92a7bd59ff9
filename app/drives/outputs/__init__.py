"""What is made of one drive: its track, its elevation profile, the profile's picture, a line for people."""
