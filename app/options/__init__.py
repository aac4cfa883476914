"""Tables of options, and a solver's options in PETSc's database."""
