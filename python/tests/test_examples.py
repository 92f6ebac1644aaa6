"""The example and the notebook do what they say, at a simulated drive."""

import json
import os
import runpy
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
EXAMPLES = Path(__file__).parent.parent / "examples"


def test_the_step(port, tmp_path, monkeypatch):
    picture = tmp_path / "step.png"
    monkeypatch.setattr("sys.argv", ["step.py", port, str(picture)])
    runpy.run_path(str(EXAMPLES / "step.py"))
    assert picture.stat().st_size > 1000


def test_the_page(port):
    page = (EXAMPLES.parent / "README.md").read_text()
    names = {"port": port}
    exec(compile(page.split("```python\n")[1].split("```")[0], "README.md", "exec"), names)
    assert abs(names["found"]["speed_rad_s"][-50:].mean() - 20.0) < 1.0


def test_the_notebook(port, monkeypatch):
    monkeypatch.setitem(os.environ, "HALLCTL_PORT", port)
    notebook = json.loads((EXAMPLES / "tour.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    names = {}
    for cell in cells:
        # Nothing that was printed is kept.
        assert not cell["outputs"] and cell["execution_count"] is None
        exec(compile("".join(cell["source"]), "tour.ipynb", "exec"), names)
    assert names["drive"].status()["state"] == "ready"
    assert 1.0 < names["rise_ms"] < 100.0
    names["drive"].close()
