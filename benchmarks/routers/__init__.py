"""What routers make of an elevation model, and of one that has measured roads in it."""
