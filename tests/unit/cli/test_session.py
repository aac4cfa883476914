"""Start of parallel commands."""

import gc
import os
import platform
import subprocess
import sys
from importlib import import_module

import pytest

from app import __version__
from app.cli import session

FAULTS = """
import os, resource, sys
from app.cli.session import keep_freed_pages
keep_freed_pages(os.environ)
text = sys.argv[1] * 20_000_000
del text
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
text = sys.argv[1] * 20_000_000
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another malloc")
@pytest.mark.parametrize("asked", [{}, {"MALLOC_MMAP_THRESHOLD_": "131072"}])
def test_freed_pages_are_kept_unless_the_environment_sets_malloc(asked):
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    found = subprocess.run(
        [sys.executable, "-c", FAULTS, "x"], env=plain | asked, capture_output=True, text=True, check=True
    )
    assert (int(found.stdout) > 1000) == bool(asked)  # 20 MB are 4883 pages


@pytest.mark.parametrize("name", "solve convert plot report reproduce subsurface sweep verify xdmf".split())
def test_every_command_prints_its_version(name, capsys):
    with pytest.raises(SystemExit) as ended:
        if name == "solve":
            session.run(None, ["solve", "--version"])
        else:
            import_module(f"app.{name}").main(["--version"])
    assert (ended.value.code, capsys.readouterr().out) == (0, f"{__version__}\n")


@pytest.mark.parametrize("enabled", [True, False])
def test_garbage_collection_is_as_before_after_failed_imports_and_skips_their_objects(enabled):
    before = gc.get_freeze_count()
    (gc.enable if enabled else gc.disable)()
    try:
        with pytest.raises(ImportError), session.imports_uncollected():
            assert not gc.isenabled()
            raise ImportError
        assert gc.isenabled() == enabled and gc.get_freeze_count() > before
    finally:
        gc.enable()
        gc.unfreeze()
