"""Method ``odometer-map``: Lahrech, Boucher, Choquel and Noyer 2005."""
