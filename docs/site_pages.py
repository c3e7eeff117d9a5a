"""Pages of the site that are made when it is built: start page, commands, environments, API.

A hook of mkdocs (see mkdocs.yml). What lies at the top of the repository is brought in with its links put right.
"""

import importlib
import inspect
import re
import shutil
import sys
from pathlib import Path
from typing import Any

from help_pages import help_pages
from mkdocs.structure.files import File, Files
from notebooks import tutorials

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import figures

ROOT = Path(__file__).parents[1]
BROUGHT_IN = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
FACES = (
    "slamgym", "slamgym.core", "slamgym.cad", "slamgym.sim", "slamgym.slam", "slamgym.planning", "slamgym.envs",
    "slamgym.dataset", "slamgym.interop", "slamgym.metrics", "slamgym.parametric", "slamgym.viz", "slamgym.agents",
    "slamgym.drawing",
)  # fmt: skip
"""Packages whose public names are the API."""
ENVIRONMENTS = {
    "slamgym/Explore-v4": "ExploreEnv",
    "slamgym/ExploreFrontiers-v4": "ExploreFrontiersEnv",
}
_PICTURE = re.compile(r"!\[([^\]]+)\]\((?:\.\./)*(images/[\w.]+)\)")
_SNIPPET = re.compile(r"```py\n--8<-- \"(examples/(\w+)\.py)\"\n```")
_TO_SOURCE = re.compile(
    r"\[([^\]]+)\]\((?:\.\./)*((?:slamgym|agents|gan|tests|benchmarks|examples)/[\w/.]+)\)"
)


def on_startup(**_: Any) -> None:
    """Put the packages together by their names where docstrings are read without importing (mkdocs.yml: paths)."""
    together = ROOT / "build" / "site"
    shutil.rmtree(together, ignore_errors=True)
    for folder, package in (("slamgym", ""), ("agents", "slamgym"), ("gan", "slamgym")):
        shutil.copytree(ROOT / folder, together / package / folder)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that no file holds."""
    pages = {
        "reference/commands.md": commands_page(),
        "reference/environments.md": environments_page(),
        **api_pages(),
        "gallery.md": gallery_page(),
        **{f"tutorials/{path.stem}.ipynb": notebook_text(path.stem) for path in tutorials()},
        **{name: brought_in(ROOT / source) for source, name in BROUGHT_IN.items()},
    }
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in the figures; links to sources, which the site lacks, become paths; a tutorial names its notebook."""
    markdown = figures.fill(markdown)
    markdown = _SNIPPET.sub(r"\g<0>\n\n[Download it as a notebook](\g<2>.ipynb).", markdown)
    return _TO_SOURCE.sub(r"`\2`", markdown)


def brought_in(path: Path) -> str:
    """A page of the repository's top as it has to be within docs/."""
    text = (
        path.read_text()
        .replace("](docs/", "](")
        .replace("](CITATION.cff)", "](faq.md#how-do-i-cite-it)")
    )
    for source, name in BROUGHT_IN.items():
        text = text.replace(f"]({source})", f"]({name})")
    return text


def notebook_text(name: str) -> str:
    """A tutorial's notebook, with results where `make site` has run it."""
    found = [ROOT / "build" / "notebooks" / f"{name}.ipynb", ROOT / "examples" / f"{name}.ipynb"]
    return next(path for path in found if path.exists()).read_text()


def gallery_page() -> str:
    """Every picture of the other pages, with its caption and the page that says how it was made."""
    parts = ["# Gallery\n\nEach picture leads to the page that explains it."]
    seen = set()
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text, link = page.read_text(), page.relative_to(ROOT / "docs").as_posix()
        title = text.partition("\n")[0].removeprefix("# ")
        for caption, image in _PICTURE.findall(text):
            if image not in seen:
                parts.append(
                    f"[![{caption}]({image})]({link})\n\n{caption[0].upper()}{caption[1:]}: [{title}]({link})"
                )
            seen.add(image)
    return "\n\n".join(parts)


def commands_page() -> str:
    """Every command with its help."""
    parts = ["# Commands\n\nWhat `--help` shows."]
    parts += [
        f"## slamgym {name}\n\n```text\n{page.strip()}\n```" for name, page in help_pages().items()
    ]
    return "\n\n".join(parts)


def environments_page() -> str:
    """The data sheets of the environments, which are their docstrings."""
    import slamgym.envs

    parts = ["# Environments"]
    for name, cls in ENVIRONMENTS.items():
        sheet = inspect.getdoc(getattr(slamgym.envs, cls)) or ""
        sheet = re.sub(r":(?:class|mod|func|data):`~?([^`]+)`", r"`\1`", sheet).replace("``", "`")
        sheet = re.sub(r"^## ", "### ", sheet, flags=re.MULTILINE)
        parts.append(f"## {name}\n\n{_arguments_as_list(sheet)}")
    return "\n\n".join(parts)


def _arguments_as_list(sheet: str) -> str:
    """Google's sections as Markdown lists."""
    sheet = re.sub(r"^(Args|Raises):$", r"**\1**\n", sheet, flags=re.MULTILINE)
    return re.sub(r"^    ([\w*]+): ", r"- `\1`: ", sheet, flags=re.MULTILINE)


def api_pages() -> dict[str, str]:
    """The public names of each package by their docstrings, a page each, and a list of the pages."""
    pages = {}
    rows = []
    for face in FACES:
        package = importlib.import_module(face)
        about = (inspect.getdoc(package) or "").splitlines()[0]
        names = [
            name
            for name in sorted(getattr(package, "__all__", ()))
            if inspect.isclass(getattr(package, name)) or inspect.isfunction(getattr(package, name))
        ]
        parts = [f"# {face}", about, *(f"::: {face}.{name}" for name in names)]
        pages[f"reference/api/{face}.md"] = "\n\n".join(parts)
        rows.append(f"- [{face}](api/{face}.md): {about}")
    return {"reference/api.md": "\n".join(["# Python API\n", *rows]), **pages}
