"""An upload on its way in: out of the body, looked at, into one blob. Knows no row and no queue."""
