"""Tables of options, and options in PETSc's database."""
