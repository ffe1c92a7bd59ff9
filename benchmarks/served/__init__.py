"""What ``serving.py`` measures with: clients, the servers that it compares, and their tiles."""
