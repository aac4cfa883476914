"""Checks of the certificate."""

from dataclasses import replace

import numpy as np
import pytest

from app.api import solver
from app.contact.certificate import certify
from app.verification import certificates

from .figures import assert_limits_are_kept, each


@pytest.mark.parametrize(("factor", "passes"), [(1.0, True), (0.01, False), (100.0, False), (np.inf, False)])
@pytest.mark.parametrize("measure", [certificates.of_anything, certificates.of_answers])
def test_a_certificate_has_to_be_right_and_to_say_something(monkeypatch, measure, factor, passes):
    def scaled(state, *wanted):
        proof = certify(state, *wanted)
        return replace(proof, error_bound=factor * proof.error_bound)

    monkeypatch.setattr(certificates, "certify", scaled)
    monkeypatch.setattr(solver, "certify", scaled)
    assert all(figure.passed for figure in measure(True)) == passes


@each(certificates.CHECKS)
def test_figures_keep_their_limits(check):
    assert_limits_are_kept(check)
