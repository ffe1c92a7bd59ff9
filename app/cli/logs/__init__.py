"""The logs that commands name, and what becomes of them."""
