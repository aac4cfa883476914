"""The complementarity problem: active set, its iteration around a KSP, nested iteration, certificate."""
