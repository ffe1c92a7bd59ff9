"""How a simulated vehicle moves: its route, its path, its speed."""
