"""What the benchmark of map matching rests on: hand-corrected ``tracks``, and ``leuven``, another matcher."""
