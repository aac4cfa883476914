"""Result files, tables and XDMF files."""
