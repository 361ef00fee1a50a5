"""The numbered examples run and do what they say."""

import runpy
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.slow
def test_missing_effect_is_named_and_the_error_falls():
    program = runpy.run_path(str(EXAMPLES / "01_name_the_missing_effect.py"))
    assert program["main"]() < 0.1


@pytest.mark.slow
def test_notebook_runs_as_written(tmp_path, monkeypatch):
    """On logs that it makes itself; the error of the fitted model on the test flight falls as it says."""
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLES.parent / "src"))
    notebook = nbformat.read(EXAMPLES / "03_the_loop.ipynb", as_version=4)
    client = NotebookClient(notebook, timeout=250, resources={"metadata": {"path": str(tmp_path)}})
    client.create_kernel_manager()
    client.km.kernel_cmd = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    client.execute()
    printed = "".join(o.get("text", "") for c in notebook.cells if c.cell_type == "code" for o in c.outputs)
    assert "Explained by" in printed


def test_compensator_in_a_strangers_loop(capsys):
    """The example's plant shares no code with the fit; on its unseen flight at least 95 % of the error goes."""
    errors = runpy.run_path(str(EXAMPLES / "02_compensator_in_your_loop.py"))["main"]()
    assert (errors["before"] > 0.02).all()
    assert (errors["after"] < 0.05 * errors["before"]).all()
    assert capsys.readouterr().out.count("\n") == 3


def test_examples_are_numbered():
    names = sorted(path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb"))
    assert [name[:2] for name in names] == [f"{k:02d}" for k in range(1, len(names) + 1)]
