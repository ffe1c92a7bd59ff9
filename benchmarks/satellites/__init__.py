"""What satellites' orbits and clocks are compared with: an independent library, and precise products."""
