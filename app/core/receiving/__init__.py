"""Files in the bodies of requests, taken out as they arrive."""
