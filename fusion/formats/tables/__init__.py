"""Tables of text: their cells, headers and names of columns, and what is done with columns that people name."""
