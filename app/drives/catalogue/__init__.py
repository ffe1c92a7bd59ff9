"""What can be chosen for a drive, as documents that forms are made of."""
