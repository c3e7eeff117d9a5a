"""The tutorials' scripts as Jupyter notebooks: write those in ``examples``, or run them as ``make site`` does.

``python docs/notebooks.py`` writes them; with ``--run FOLDER`` it runs them and keeps the results there.
"""

import argparse
import ast
import json
import re
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
ADDRESS = "git+https://github.com/OWNER/slamgym"
"""Where pip gets the package on Colab: OWNER is filled in at the release, before the notebooks are written anew."""
EXTRAS = {"own_reward": "[agents]", "maps_to_cad": "[gan]", "log_to_drawing": ""}
"""What each notebook installs."""
SMALL = {"own_reward": ["2000", "4"], "maps_to_cad": ["8", "0.5"], "log_to_drawing": []}
"""Arguments with which it runs in about a minute; the script's own are larger."""
PICTURES = {"log_to_drawing": "log_to_drawing/home.png"}
"""What it shows at the end."""
_INSTALL = """\
import importlib.util

if importlib.util.find_spec("slamgym") is None:
    %pip install --quiet "slamgym{extra} @ {address}"\
"""
_SNIPPET = re.compile(r"```py\n--8<-- \"(examples/(\w+)\.py)\"\n```")


def tutorials() -> list[Path]:
    """The scripts that the tutorials' pages show."""
    found = (
        _SNIPPET.search(page.read_text())
        for page in sorted((ROOT / "docs" / "tutorials").glob("*.md"))
    )
    return [ROOT / match[1] for match in found if match]


def notebook_of(script: Path) -> str:
    """A script as a notebook: an installation, its docstring as text, a cell for its imports and each later part."""
    source = script.read_text()
    lines, tree = source.splitlines(), ast.parse(source)
    docstring, *nodes = tree.body
    name = script.stem
    install = _INSTALL.format(extra=EXTRAS[name], address=ADDRESS)
    given = ", ".join(f'"{argument}"' for argument in ["", *SMALL[name]])
    about = (ast.get_docstring(tree) or "").partition("\n\nNeeds")[0].partition("\n\nRun")[0]
    cells: list[tuple[str, str]] = [
        ("code", install),
        ("markdown", about),
        (
            "code",
            f"import sys\n\nsys.argv = [{given}]  # small enough for a minute; more gives better results",
        ),
    ]
    begin = docstring.end_lineno or 0
    imports = [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    for node in [imports[-1], *(node for node in nodes if node not in imports)]:
        end = node.end_lineno or begin
        if lines[end - 1 : end] and "  # noqa" in lines[end - 1]:
            lines[end - 1] = lines[end - 1].partition("  # noqa")[0]
        cells.append(("code", "\n".join(lines[begin:end]).strip()))
        begin = end
    if name in PICTURES:
        shown = f'from IPython.display import Image\n\nImage("{PICTURES[name]}", width=600)'
        cells.append(("code", shown))
    notebook = {
        "cells": [
            {
                "cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": text,
                **({"outputs": [], "execution_count": None} if kind == "code" else {}),
            }
            for number, (kind, text) in enumerate(cells)
        ],
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }  # fmt: skip
    return json.dumps(notebook, indent=1) + "\n"


def run_notebook(path: Path, results: Path) -> None:
    """Run a notebook in a folder of its own, and keep it with its results; raises what a cell raises."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": folder}})
        client.execute()
    results.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, results / path.name)


def main() -> None:
    """Write the notebooks, or run them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, help="run them, and keep the results in this folder")
    given = parser.parse_args()
    for script in tutorials():
        path = script.with_suffix(".ipynb")
        if given.run is None:
            path.write_text(notebook_of(script))
        else:
            run_notebook(path, given.run)


if __name__ == "__main__":
    main()
