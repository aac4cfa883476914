"""The command that writes the verification document."""

from app.verification import verify


def test_one_check_alone(checks, tmp_path):
    assert verify.main(["-o", str(tmp_path), "--only", "good", "--quick"]) == 0
    text = (tmp_path / "verification.md").read_text()
    assert "All 1 limits are kept" in text and "--only good --quick" in text and "Bad" not in text


def test_bad_input_is_one_line(checks, tmp_path, capsys):
    assert verify.main(["-o", str(tmp_path), "--only", "better"]) == 2
    assert capsys.readouterr().err == "error: --only better: unknown; allowed: good, bad\n"
    assert verify.main(["-o", str(tmp_path / "a" / "b")]) == 2
