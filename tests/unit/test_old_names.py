"""Option files of 0.1.0 mean today what they meant."""

import pytest
from cases import APPROACH, hertz
from running import solve

from app.commands import places
from app.commands.problem_options import suggesting
from app.errors import InputError
from app.old_names import NAMES, RENAMED, in_words_of_today

FAST = """
-lcp_nested true
-lcp_coarse_rtol 2e-3
-lcp_prolongation lift
-lcp_window 0.06
-lcp_merge 0.4
-lcp_foresight 1.3
-lcp_precision single
-ksp_type python
-ksp_python_type app.multigrid.krylov.TrackingCG
-ksp_norm_type unpreconditioned
-ksp_rtol 0.06
-ksp_max_it 50
-pc_type python
-pc_python_type app.multigrid.circulant.Circulant
-pc_circulant_extend 3
"""
SINCE = {"lcp_coarsest": 8, "ksp_converged_use_initial_residual_norm": ""}


def test_the_default_method_of_0_1_0_is_still_that(tmp_path):
    (tmp_path / "mine.opts").write_text(FAST)
    given = places.read(["app.solve", "-options_file", str(tmp_path / "mine.opts")], {})
    files, words = given.files_and_words(given.texts.keys())
    old = solve(hertz(32), APPROACH, files, **words, **SINCE)
    words = {"lcp_predictor": 1.3, "pc_circulant_extend": 3}  # of that release
    assert old.history["residual"] == solve(hertz(32), APPROACH, "fast", **words).history["residual"]
    assert len([note for note in old.notes if "is called" in note or "is gone" in note]) == 2


def test_what_is_renamed_or_gone_is_told_once_each():
    texts, warnings = in_words_of_today(dict.fromkeys(["lcp_rtol", *NAMES], "1"))
    assert texts == {"lcp_rtol": "1"} | dict.fromkeys(RENAMED.values(), "1")
    assert sorted(warning.split()[0] for warning in warnings) == sorted(f"-{name}" for name in NAMES)
    assert in_words_of_today({"lcp_rtol": "1"}) == ({"lcp_rtol": "1"}, [])


def test_words_of_today_override_those_of_before():
    solved = solve(hertz(24), APPROACH, {"old": {"lcp_foresight": 7}}, lcp_predictor=1.3)
    assert "-lcp_predictor 1.3 " in solved.options
    solved = solve(hertz(24), APPROACH, "fast", lcp_foresight=0)
    assert "-lcp_predictor 0 " in solved.options


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_both_names_in_one_place_are_refused(old, new):
    with pytest.raises(InputError, match=f"-{old} is called -{new} now"):
        in_words_of_today({old: "1", new: "1"})


@pytest.mark.parametrize("name", sorted(NAMES))
def test_old_names_are_not_unknown(name):
    with pytest.raises(InputError, match="^what is wrong$"), suggesting({name: "1"}):
        raise InputError("what is wrong")
