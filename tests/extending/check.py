"""Check ``energy`` of the verification document: the load is the derivative of the elastic energy."""

_CHECK = '''
def energy(quick):
    """Compare the load with the derivative of the elastic energy p.Ap / 2 in the approach."""
    figures, shares = [], np.array([0.45, 0.5, 0.55])
    for periodic in patches(quick):
        problem = _problem(periodic)
        approaches = _APPROACH * shares
        solutions = [solved(problem, approach=approach) for approach in approaches]
        energies = [problem.grid.cell_area * (s.pressure * s.displacement).sum() / 2 for s in solutions]
        error = np.gradient(energies, approaches)[1] / solutions[1].load - 1
        figures.append(Figure(f"relative error of the load, {patch_name(periodic)}", abs(error), most=0.01))
    return figures


CHECKS = (
    Check("energy", "Energy", energy.__doc__, energy),
'''
CHANGES = {"app/verification/invariances.py": {"\nCHECKS = (\n": _CHECK}}
