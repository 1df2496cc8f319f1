"""Run the notebook of `examples/` from the first cell to the last, as `make test-docs` does; its name keeps it from `make test`.

Usage: python -m checks.documents.run_notebook NOTEBOOK [OUT]     (OUT gets the notebook with its outputs)
"""

import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient


def run_notebook(path: Path) -> nbformat.NotebookNode:
    """Run a notebook in a folder of its own; an error in a cell is raised."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": folder}}).execute()
    return notebook


if __name__ == "__main__":
    made = run_notebook(Path(sys.argv[1]))
    if len(sys.argv) > 2:
        for cell in made.cells:
            cell.metadata.pop("execution", None)  # times of day
        nbformat.write(made, sys.argv[2])
