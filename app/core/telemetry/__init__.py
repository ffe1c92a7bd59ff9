"""What processes tell of themselves: lines of the log, figures that are counted, traces. Knows no subject."""
