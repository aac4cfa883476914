"""Commands: one module for each, and modules that they share."""
