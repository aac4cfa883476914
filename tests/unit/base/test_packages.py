"""Packages compiled for another numpy, and packages that tests may import."""

import ast
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from processes import TESTS, run

COMPILED = "h5py", "matplotlib", "numba", "petsc4py", "scipy"
# What a package compiled for numpy 1 does with numpy 2, from its C code.
COMPILED_FOR_ANOTHER_NUMPY = """
import sys
sys.stderr.write("A module that was compiled using NumPy 1.x cannot be run in NumPy 2\\n" * 20)
raise {}
"""
FAILURES = 'ImportError("numpy.core.multiarray failed to import")', 'ValueError("numpy.dtype size changed")'
COMMANDS = [
    path.stem for path in sorted((TESTS.parent / "app").glob("*.py")) if "import main" in path.read_text()
]
WORDS = {"solve": ["-problem", "hertz"], "convert": ["s.npy", "-o", "s.h5"]}
CALLS = (
    "from app import solve",
    "from app.base import hdf5; hdf5.File",
    "from app import ContactSolver",
    "import app.api.solution",
)
# What `run/setup --dev` installs, by the names that are imported.
INSTALLED = {*COMPILED, *"jinja2 llvmlite mpi4py numpy tabulate tqdm yaml".split()}
INSTALLED |= {"hypothesis", "nbclient", "jupyter_client", "nbformat", "pytest", "setuptools"}


@pytest.fixture(scope="module")
def incompatible(tmp_path_factory):
    """Environment of Python with packages compiled for another numpy."""
    folder = tmp_path_factory.mktemp("packages")
    for i, name in enumerate(COMPILED):
        (folder / name).mkdir()
        text = COMPILED_FOR_ANOTHER_NUMPY.format(FAILURES[i % 2])
        (folder / name / "__init__.py").write_text(text)
    return {"PYTHONPATH": f"{folder}:{TESTS.parent}"}


def test_a_command_reports_packages_for_another_numpy_in_one_line(incompatible, tmp_path):
    def end_of(name):
        return run("-m", f"app.{name}", *WORDS.get(name, ["-h"]), env=incompatible, cwd=tmp_path)

    with ThreadPoolExecutor(2) as pool:
        ends = dict(zip(COMMANDS, pool.map(end_of, COMMANDS), strict=True))
    assert len(ends) == 10
    for name in (
        "convert",
        "law",
        "sweep",
        "xdmf",
    ):  # need none of them for an array of numpy, and for the help
        del ends[name]
    for name, end in ends.items():
        (line,) = end.stderr.splitlines()
        assert (end.returncode, end.stdout) == (2, ""), name
        assert line.startswith("error: ") and "does not work with numpy" in line, name


def test_a_program_gets_a_one_line_import_error_for_another_numpy(incompatible):
    program = (
        "import app\nfor call in {!r}:\n"
        "    try:\n        exec(call)\n"
        "    except ImportError as error:\n"
        "        assert isinstance(error, ValueError), error\n        print(error)\n"
    )
    done = run("-c", program.format(CALLS), env=incompatible)
    lines = done.stdout.splitlines()
    assert (done.returncode, done.stderr, len(lines)) == (0, "", len(CALLS))
    assert all("does not work with numpy" in line for line in lines)


def test_other_import_errors_of_a_package_are_unchanged(tmp_path):
    (tmp_path / "h5py").mkdir()
    text = "import sys; sys.stderr.write('a warning\\n'); raise ImportError('libhdf5.so: cannot open')"
    (tmp_path / "h5py" / "__init__.py").write_text(text)
    done = run("-c", "from app.base import hdf5; hdf5.File", env={"PYTHONPATH": f"{tmp_path}:{TESTS.parent}"})
    assert done.stderr.startswith("a warning\n")
    assert done.stderr.endswith("ImportError: libhdf5.so: cannot open\n")


def test_a_missing_mpi_library_is_reported_in_one_line(tmp_path):
    (tmp_path / "mpi4py").mkdir()
    (tmp_path / "mpi4py" / "__init__.py").touch()
    (tmp_path / "mpi4py" / "MPI.py").write_text(
        "raise RuntimeError('cannot load MPI library\\n/v/libmpi.so')"
    )
    env = {"PYTHONPATH": f"{tmp_path}:{TESTS.parent}"}
    for call in (("-m", "app.solve"), ("-c", "import app; app.solve")):
        done = run(*call, env=env)
        *trace, line = done.stderr.splitlines()
        assert "not installed: an MPI library. Install by: " in line
        assert done.returncode == 1 if trace else (done.returncode, done.stdout) == (2, "")


def test_tests_import_only_packages_that_setup_installs():
    own = {path.stem for path in TESTS.rglob("*.py")} | {"app", "benchmarks", "extending"}
    allowed = own | INSTALLED | sys.stdlib_module_names
    for path in [*TESTS.rglob("*.py"), TESTS.parent / "conftest.py"]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            assert {name.partition(".")[0] for name in names} <= allowed, path


def test_only_tests_and_examples_of_the_program_are_collected(pytestconfig):
    ignored = pytestconfig.hook.pytest_ignore_collect
    root = TESTS.parent
    for path in [*TESTS.glob("*.py"), *root.glob("benchmarks/[a-z]*.py"), root / "docs" / "conf.py"]:
        assert ignored(collection_path=path, config=pytestconfig), path
    for path in (TESTS / "unit" / "base" / "test_packages.py", root / "app" / "solver.py"):
        assert not ignored(collection_path=path, config=pytestconfig), path


@pytest.mark.parametrize("name", ["h5py", "petsc4py"])
def test_packages_that_start_mpi_skip_the_search_for_networks(name, tmp_path):
    (tmp_path / f"{name}.py").write_text("import os; print(os.environ.get('OMPI_MCA_pml'))")
    program = f"import os, app, {name}; print(os.environ.get('OMPI_MCA_pml'))"
    done = run("-c", program, env={"PYTHONPATH": f"{tmp_path}:{TESTS.parent}"})
    assert (done.stdout.split(), done.stderr) == (["ob1", "None"], "")


def test_warnings_turned_into_errors_do_not_stop_the_import_of_packages():
    imports = "import app.api.views, app.io.result, app.cli.report; from app import solve"
    done = run("-W", "error", "-X", "dev", "-c", imports)  # dev: files that are not closed, too
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr and "ResourceWarning" not in done.stderr, done.stderr
