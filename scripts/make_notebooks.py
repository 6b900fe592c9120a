"""Run the example notebooks and keep what they show: `make notebooks`.

python scripts/make_notebooks.py                 all of docs/notebooks
python scripts/make_notebooks.py NOTEBOOK.ipynb  one of them

Each runs in an empty folder that is thrown away. Kept are code, words, pictures and tables; times of
execution are dropped, and the plain text that stands for a richer form.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
MOST_BYTES = 400_000
TIMEOUT = 600  # s, of a cell


def run(path: Path) -> int:
    """Execute a notebook in place; its size (bytes)."""
    notebook = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=TIMEOUT, resources=resources).execute()
        content = nbformat.writes(cleaned(notebook)).replace(folder, ".")
    size = len(content.encode())
    if size > MOST_BYTES:
        raise SystemExit(f"{path.name}: expected at most {MOST_BYTES} bytes, got {size}")
    path.write_text(content + "\n", encoding="utf-8")
    return size


def cleaned(notebook: Any) -> Any:
    """Without what differs from run to run, and from machine to machine."""
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        cell.metadata = {}
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if len(data) > 1:
                data.pop("text/plain", None)
    return notebook


def main() -> None:
    """Run those that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "notebooks", nargs="*", type=Path, default=sorted(NOTEBOOKS.glob("*.ipynb"))
    )
    for path in parser.parse_args().notebooks:
        print(f"{path.name}: {run(path) / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
