"""Floor 3: the complementarity problem: active set, its iteration around a KSP, nested iteration, certificate."""
