"""Test of progress."""

from app.methods.progress import PATIENCE, HalvingTest


def test_number_that_is_not_halved_stagnates_after_some_iterations():
    progress = HalvingTest(8.0)
    for _ in range(PATIENCE):
        assert not progress.stagnates
        progress.update(5.0)
    assert progress.stagnates
    progress.update(4.0)
    assert progress.best == 4.0 and not progress.stagnates


def test_other_progress_counts():
    progress = HalvingTest(8.0)
    for _ in range(2 * PATIENCE):
        progress.update(9.0, otherwise=True)
    assert progress.best == 8.0 and not progress.stagnates


def test_zero_is_not_halved_again():
    progress = HalvingTest(1.0)
    for _ in range(PATIENCE + 1):
        assert not progress.stagnates
        progress.update(0.0)
    assert progress.stagnates
