"""What sweeps are made of: runs of the program in processes of their own, and what they came to. Not collective."""
