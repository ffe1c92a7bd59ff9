"""A hot standby of the database, from which a process of the API reads the map as long as it follows closely enough."""
