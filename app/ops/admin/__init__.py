"""Named queries for operators: what each is for, its columns, and how it is read."""
