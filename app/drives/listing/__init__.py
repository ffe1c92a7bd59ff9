"""Lists of drives: their orders, places in them and what is searched for."""
