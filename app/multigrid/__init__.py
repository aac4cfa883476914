"""Floor 2: linear solvers for the masked system C A C p = b: grid hierarchy, transfers, PCMG, preconditioners."""
