"""The parser of commands in the person's language."""
