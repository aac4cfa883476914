"""What the commands are made of: start-up and end, where options come from, problems from options, reports."""
