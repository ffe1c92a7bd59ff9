"""Who may ask for what: owners, keys, sessions, the table of routes and the gate before all of them."""
