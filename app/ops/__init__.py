"""What operators look at: health, metrics, figures, kinds of problems."""
