"""docs/gallery/first_notebook.ipynb: executed by Jupyter, it shows pictures and tables."""

import base64
import re
import sys

import nbclient
import nbformat
import pytest
from documents import ROOT
from jupyter_client.manager import AsyncKernelManager

NOTEBOOK = ROOT / "docs" / "gallery" / "first_notebook.ipynb"
PNG = b"\x89PNG\r\n\x1a\n"
MIN_BYTES = 5_000  # of a picture that is not empty
PICTURES = (
    "solution.plot()",
    "below.plot()",
    "rough.plot()",
    'solution.plot("section_x", ax=right)',
    'fields.pressure.sel(y=0, method="nearest").plot();',
)
TABLES = {  # last line of a cell -> pictures in its HTML, words of its table
    "solution": (1, "maximum pressure", "100 N"),
    "path": (1, "load [N]", "9 of 9 steps"),
    "refine(coarse, until=0.02, load=100)": (1, "128\u00a0x\u00a0128", "reached"),
    "surface": (1, "256 x 256", "rms slope"),
    "rough.patches()": (1, "7 contact spots", "centre x [mm]"),
    "solve_many(problems, mean_pressure=200, progress=True)": (0, "6 solutions", "True"),
    'read_result("ball.h5")': (1, "maximum pressure", "100 N"),
}


def execute(notebook, folder, **options):
    """Execute a notebook by the Python of the tests."""
    manager = AsyncKernelManager()
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    manager.kernel_spec.argv = command  # not Debian's python3, which is that of the installed kernel
    options |= {"km": manager, "timeout": 120, "resources": {"metadata": {"path": folder}}}
    with pytest.MonkeyPatch.context() as patch:
        for variable in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR"):  # not those of the user
            patch.setenv(variable, folder)
        nbclient.NotebookClient(notebook, **options).execute()


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """Execute the notebook; return its cells of code."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    execute(notebook, str(tmp_path_factory.mktemp("notebook")))
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def find(cells, last_line):
    [cell] = [cell for cell in cells if cell.source.splitlines()[-1] == last_line]
    return cell


def data(cell, kind):
    return [output.data[kind] for output in cell.outputs if kind in output.get("data", {})]


def test_it_is_stored_without_outputs():
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert not cell.get("outputs") and cell.get("execution_count") is None


@pytest.mark.parametrize("line", PICTURES)
def test_plots_are_pictures_without_text(cells, line):
    cell = find(cells, line)
    [picture] = data(cell, "image/png")
    picture = base64.b64decode(picture)
    assert picture.startswith(PNG) and len(picture) > MIN_BYTES
    assert not [output for output in cell.outputs if output.output_type == "execute_result"]


@pytest.mark.parametrize("line", TABLES)
def test_objects_are_tables_with_a_picture(cells, line):
    count, *words = TABLES[line]
    cell = find(cells, line)
    [html] = data(cell, "text/html")
    pictures = [base64.b64decode(code) for code in re.findall(r"src='data:image/png;base64,([^']*)'", html)]
    assert html.count("<table>") == 1 and len(pictures) == count
    assert all(picture.startswith(PNG) and len(picture) > MIN_BYTES for picture in pictures)
    text = re.sub(r"<[^>]*>", "", html)
    assert all(word in text for word in words)


def test_nothing_but_progress_is_written_to_standard_error(cells):
    streams = [output for cell in cells for output in cell.outputs if output.get("name") == "stderr"]
    lines = [line.strip() for output in streams for line in re.split(r"[\r\n]", output.text)]
    assert [line for line in lines if line and not re.match(r"(path|solve): |note: compiling", line)] == []
    bars = data(find(cells, "path"), "application/vnd.jupyter.widget-view+json")  # with ipywidgets
    assert bars or any(line.startswith("path: 100%") for line in lines)


def test_wrong_input_shows_the_line_of_the_user_and_the_message(tmp_path):
    source = "from app import Sphere\n\ndef ball(radius):\n    return Sphere(radius)\n\nball(-1)"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)])
    execute(notebook, str(tmp_path), allow_errors=True)
    [error] = notebook.cells[0].outputs
    text = re.sub(r"\x1b\[[\d;]*m", "", "\n".join(error.traceback))
    assert "return Sphere(radius)" in text and text.splitlines()[-1].startswith("InputError: radius -1")
    assert "app/" not in text and len(text.splitlines()) < 25
