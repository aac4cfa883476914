"""Studies of the method on small dense matrices (Sec. 4.4 of the paper)."""
