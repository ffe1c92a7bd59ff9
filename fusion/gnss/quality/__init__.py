"""How good positions and error models are: errors against a truth, laws of residuals, residuals by satellite."""
