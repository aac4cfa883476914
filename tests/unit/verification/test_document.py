"""The verification document."""

from app.verification import document, verify


def test_the_document_has_every_figure_and_the_command_fails_with_one(checks, tmp_path, capsys):
    assert verify.main(["-o", str(tmp_path)]) == 1
    text = (tmp_path / "verification.md").read_text()
    assert "1 of 2 limits are not kept" in text and "**FAIL**" in text and "--only bad" in text
    assert "error: 1, must be ≤ 0.5" in capsys.readouterr().out
    assert (tmp_path / document.ORDERS).is_file() and document.ORDERS in text
    assert not (tmp_path / document.SHARPNESS).exists()
