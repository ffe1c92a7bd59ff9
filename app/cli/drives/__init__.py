"""``versant drives``: drives of a running service listed, shown, deleted, processed again; a client of its API."""
