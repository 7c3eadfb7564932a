"""Every notebook runs from its first cell to its last, in a kernel of this very interpreter, away from the checkout."""

import sys
from pathlib import Path

import nbformat
import pytest
from jupyter_client import AsyncKernelManager
from jupyter_client.kernelspec import KernelSpec
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

import formulations

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
LIMIT = 300  # seconds for one cell
PACKAGES = str(Path(formulations.__file__).parents[1])  # of the code under test, installed or not


class ThisInterpreter(AsyncKernelManager):
    """Starts the kernel in the running interpreter, whatever kernels are installed for the user or the machine."""

    @property
    def kernel_spec(self):
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        return KernelSpec(argv=command, display_name="Python 3", language="python")


@pytest.fixture(autouse=True)
def kernel_environment(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setenv("PYTHONPATH", PACKAGES)


def run(notebook, folder):
    client = NotebookClient(
        notebook, timeout=LIMIT, kernel_name="python3", kernel_manager_class=ThisInterpreter
    )
    client.execute(cwd=str(folder))


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_to_its_closing_assertion(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs for cell in code), "store notebooks without outputs"
    assert "assert" in code[-1].source
    run(notebook, tmp_path)


@pytest.mark.slow
def test_notebook_that_fails_is_noticed(tmp_path):
    broken = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("assert False")])
    with pytest.raises(CellExecutionError, match="AssertionError"):
        run(broken, tmp_path)


@pytest.mark.slow
def test_kernel_is_this_interpreter_with_the_packages_under_test(tmp_path):
    notebook = nbformat.v4.new_notebook(
        cells=[
            nbformat.v4.new_code_cell(
                "import sys\nprint(sys.executable)\nimport formulations\nprint(formulations.__file__)"
            )
        ]
    )
    run(notebook, tmp_path)
    assert notebook.cells[0].outputs[0].text.split() == [sys.executable, formulations.__file__]
