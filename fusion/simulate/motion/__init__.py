"""How a simulated vehicle moves: its route, its path, its speed and attitude. Truth without any error."""
