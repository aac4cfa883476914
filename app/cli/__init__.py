"""Commands: one module each, and shared modules."""
