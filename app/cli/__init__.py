"""Commands: start and end, options, problems, and one module for each command."""
