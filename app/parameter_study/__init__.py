"""Parameter studies: many runs of a program, one table."""
