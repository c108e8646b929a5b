"""The notebooks: committed without outputs, every link leads somewhere, and they run from a folder in which nothing is."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
by_name = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path: Path, kind: str) -> list[dict]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


@by_name
def test_a_notebook_is_committed_without_outputs(path):
    for cell in cells(path, "code"):
        assert (cell["outputs"], cell["execution_count"]) == ([], None), f"clear the outputs of {path.name}"


@by_name
def test_links_of_a_notebook_lead_to_files(path):
    text = "".join(line for cell in cells(path, "markdown") for line in cell["source"])
    links = re.findall(r"\]\(([^)#:]+)\)", text)
    assert links
    assert not [link for link in links if not (path.parent / link).exists()]


@pytest.mark.slow
@pytest.mark.timeout(600)
@by_name
def test_a_notebook_runs_and_draws(path, tmp_path, monkeypatch):
    reason = "the extra is missing: pip install -c constraints.txt -e '.[notebooks]'"
    nbclient, nbformat, _ = (pytest.importorskip(name, reason=reason) for name in ("nbclient", "nbformat", "ipykernel"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=500, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 5
