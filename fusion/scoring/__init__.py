"""How good a height profile is: profiles laid onto a surveyed one, and their errors of grade by length."""
