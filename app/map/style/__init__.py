"""How a map in a browser looks: its style, its signs and its letters, all made by the service itself."""
