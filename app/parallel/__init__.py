"""How ranks share rows of a grid and talk to each other."""
