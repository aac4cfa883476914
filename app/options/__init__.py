"""Tables of options, and the options of one solver in PETSc's database."""
