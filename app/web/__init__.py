"""Pages for people: built by npm from ``src`` into ``built``, which is shipped; served here. They load nothing from
elsewhere, unless a background map of another host is set."""
