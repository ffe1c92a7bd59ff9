"""What ``privacy_attack.py`` consists of: a town that drives, an attacker that reads what is public, and a guesser."""
