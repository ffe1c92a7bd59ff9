"""A person's own data: all of it as one archive, its removal with a receipt, and for how long logs are kept."""
