"""Compilation before the first solve."""

from processes import run


def test_a_warmed_up_machine_compiles_nothing():
    command = "-m", "app.solve", "--warm-up"
    run(*command, timeout=300)
    again = run(*command)
    assert again.stdout == "all loops are compiled\n"
    assert not again.stderr
