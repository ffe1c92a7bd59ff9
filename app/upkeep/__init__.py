"""A service kept whole: backups of all that it holds, their return, and what is wrong with it."""
