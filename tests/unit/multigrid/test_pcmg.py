"""The multigrid PC in the solvers of options."""

import warnings

import pytest
from cases import hertz
from operators import asymmetry

from app import ContactSolver, InputError, solve


def asymmetry_of(solver, contact):
    """Return the asymmetry of a solver's preconditioner on a contact set."""
    linear, operator = solver._strategy.solver, solver.hierarchy.target
    operator.mask[...] = contact
    linear.set_contact()
    return asymmetry(linear.ksp.getPC(), operator, linear.mat)


CYCLES = [
    ("norm", {}),
    ("norm", {"pc_mg_cycle_type": "w", "mg_levels_ksp_max_it": 2}),
    ("norm", {"mg_levels_2_pc_sor_omega": 0.5, "mg_levels_pc_sor_backward": ""}),
    ("norm", {"mg_levels_pc_sor_symmetric": ""}),
    ("norm", {"pc_mg_type": "additive", "mg_levels_2_pc_sor_backward": ""}),
    ("norm", {"pc_mg_levels": 1}),
    ("fmg_v11", {}),  # whose file says forward
    ("fmg_v11", {"pc_mg_type": "additive"}),
    ("fmg_v11", {"pc_mg_levels": 1}),
    ("fmg_fft", {}),
]


NORMS = {"cg": "natural", "minres": "preconditioned", "lsqr": "unpreconditioned"}


@pytest.mark.parametrize("kind", NORMS)
@pytest.mark.parametrize(("method", "options"), CYCLES)
def test_cycle_is_symmetric_for_krylov_methods_that_need_it(kind, method, options):
    options = {"ksp_type": kind, "ksp_norm_type": NORMS[kind]} | options
    with warnings.catch_warnings(), ContactSolver(hertz(32), method, options | {"pc_type": "mg"}) as solver:
        warnings.simplefilter("ignore", RuntimeWarning)
        assert asymmetry_of(solver, solver.solve(approach=0.1).contact) < 1e-14


def test_cycle_is_that_of_the_method_file_otherwise():
    for method, options in (("fmg_v11", {}), ("norm", {"pc_type": "mg", "ksp_type": "fcg"})):
        with ContactSolver(hertz(32), method, options) as solver:
            assert asymmetry_of(solver, solver.solve(approach=0.1).contact) > 1e-4


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("norm", {"pc_mg_type": "kaskade"}, "-pc_mg_type kaskade: -ksp_type cg needs a symmetric cycle"),
        ("fmg_v11", {"pc_mg_type": "full"}, "-pc_mg_type full: -ksp_type cg needs a symmetric cycle"),
        ("mg_v10", {}, "-ksp_type cg: needs a symmetric preconditioner"),
        ("fmg_v01", {}, "-ksp_type cg: needs a symmetric preconditioner"),
        ("norm", {"pc_mg_distinct_smoothup": ""}, "-ksp_type cg: needs a symmetric preconditioner"),
        ("norm", {"pc_mg_galerkin": "both"}, "-pc_mg_galerkin both: .* must be none"),
    ],
)
def test_cycles_that_a_method_cannot_use_are_refused(method, options, message):
    options = {"ksp_type": "cg", "ksp_max_it": 100, "pc_type": "mg"} | options
    with pytest.raises(InputError, match=message):
        solve(hertz(32), approach=0.1, method=method, options=options)


def test_multigrid_speeds_up_conjugate_gradients():
    options = {"ksp_type": "cg", "pc_type": "mg"}
    with ContactSolver(hertz(64), "norm", options) as fast, ContactSolver(hertz(64), "norm") as plain:
        fast, plain = fast.solve(approach=0.1), plain.solve(approach=0.1)
    assert fast.converged and fast.inner_iterations < plain.inner_iterations / 2
    assert fast.load == pytest.approx(plain.load, rel=fast.error_bound + plain.error_bound)


@pytest.mark.parametrize("method", ["mg_v10", "fmg_v11"])
def test_mg_is_an_alias_of_the_multigrid_pc(method):
    pc = {"pc_type": "python", "pc_python_type": "app.multigrid.ContactMG"}
    short, long = (solve(hertz(32), approach=0.1, method=method, options=options) for options in ({}, pc))
    assert short.converged and long.pressure.tolist() == short.pressure.tolist()
    assert long.work_units == short.work_units
    assert long.operator_applications == short.operator_applications


def test_work_of_multigrid_in_windows_is_counted():
    """Windows have their own coarser grids."""
    with ContactSolver(hertz(160), "fast", {"pc_type": "mg"}) as solver:
        first, second = (solver.solve(approach=0.1) for _ in range(2))
    plain = solve(hertz(160), approach=0.1, method="fast")
    assert first.converged
    assert first.load == pytest.approx(plain.load, rel=first.error_bound + plain.error_bound)
    assert second.operator_applications == pytest.approx(first.operator_applications)


@pytest.mark.parametrize("options", [{"pc_mg_type": "additive"}, {"pc_mg_levels": 1}])
def test_cycles_without_smoothers_after_the_coarse_grid_suit_the_default_method(options):
    """Its own CG took 250 and 650 iterations with one-way sweeps."""
    solution = solve(hertz(64), approach=0.1, method="fast", options={"pc_type": "mg"} | options)
    assert solution.converged and solution.inner_iterations < 30
