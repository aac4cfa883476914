"""Parameter studies: many runs of a program, with one table of results."""
