"""Every notebook runs from its first cell to its last, in a kernel of this very interpreter, away from the checkout.

They are stored with what they show. After a change: ``python tests/test_notebooks.py --record [NAME ...]``.
"""

import hashlib
import os
import re
import sys
import tempfile
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


def kernel_environment(environment):
    """Of a kernel that draws into its notebook, and imports the code under test."""
    environment.pop("MPLBACKEND", None)
    environment["PYTHONPATH"] = PACKAGES


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    changed = dict(os.environ)
    kernel_environment(changed)
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("PYTHONPATH", changed["PYTHONPATH"])


def run(notebook, folder):
    client = NotebookClient(
        notebook,
        timeout=LIMIT,
        kernel_name="python3",
        kernel_manager_class=ThisInterpreter,
        record_timing=False,
    )
    client.execute(cwd=str(folder))


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def digest(notebook):
    """Of what was run: all code, in order."""
    sources = "\0".join(cell.source for cell in code_cells(notebook))
    return hashlib.sha256(sources.encode()).hexdigest()


def shown(notebook):
    """What each cell shows: the kinds of its outputs, and its words; numbers may differ in their last digits, times by more."""
    return [joined(map(kind_and_words, cell.outputs)) for cell in code_cells(notebook)]


def joined(outputs):
    """Outputs, of which printed ones that follow each other are one: where they are cut hangs on time."""
    found = []
    for kinds, words in outputs:
        if kinds == ["stdout"] and found and found[-1][0] == kinds:
            found[-1][1].extend(words)
        else:
            found.append((kinds, words))
    return found


def kind_and_words(output):
    data = output.get("data", {})
    kinds = sorted(data) or [output.get("name", output.output_type)]
    text = output.get("text", "") or ("" if "image/png" in data else data.get("text/plain", ""))
    return kinds, re.findall(r"[^\W\d_]{3,}", text)


def draws(source):
    """How many figures a cell makes."""
    return len(re.findall(r"plt\.subplots\(|^(?:\w+, figure = )?show\(", source, re.MULTILINE))


def record(path):
    """Run a notebook, and store it with what it shows and the digest of what was run."""
    notebook = nbformat.read(path, as_version=4)
    metadata = notebook.metadata.copy()
    with tempfile.TemporaryDirectory() as folder:
        run(notebook, folder)
    notebook.metadata = metadata | {"obsplan": {"source": digest(notebook)}}
    for cell in code_cells(notebook):
        cell.metadata.pop("execution", None)
    nbformat.write(notebook, path)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_outputs_are_of_the_code_beside_them_and_every_figure_is_there(path):
    notebook = nbformat.read(path, as_version=4)
    assert notebook.metadata["obsplan"]["source"] == digest(notebook), "record it again"
    for cell in code_cells(notebook):
        kinds = [output.get("name", output.output_type) for output in cell.outputs]
        assert not {"error", "stderr"} & set(kinds)
        pictures = sum("image/png" in output.get("data", {}) for output in cell.outputs)
        assert pictures == draws(cell.source), cell.source


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_to_its_closing_assertion_and_shows_what_is_stored(path, tmp_path):
    stored = nbformat.read(path, as_version=4)
    fresh = nbformat.read(path, as_version=4)
    assert "assert" in code_cells(fresh)[-1].source
    run(fresh, tmp_path)
    assert shown(fresh) == shown(stored)


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


if __name__ == "__main__":
    if sys.argv[1:2] != ["--record"]:
        raise SystemExit(__doc__)
    kernel_environment(os.environ)
    for notebook_path in NOTEBOOKS:
        if not sys.argv[2:] or notebook_path.stem in sys.argv[2:]:
            record(notebook_path)
            print(f"recorded {notebook_path.name}")  # noqa: T201 - told on a terminal
