"""Linear solvers for the masked system C A C p = b: grid hierarchy, transfers, PCMG."""
