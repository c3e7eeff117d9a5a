"""Pages of the site that are made when it is built: start page, commands, environments, API.

A hook of mkdocs (see mkdocs.yml). What lies at the top of the repository is brought in with its links put right.
"""

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
BROUGHT_IN = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
FACES = (
    "slamgym", "slamgym.core", "slamgym.cad", "slamgym.sim", "slamgym.slam", "slamgym.planning", "slamgym.envs",
    "slamgym.dataset", "slamgym.interop", "slamgym.metrics", "slamgym.parametric", "slamgym.viz", "slamgym.agents",
    "slamgym.drawing",
)  # fmt: skip
"""Packages whose public names are the API."""
ENVIRONMENTS = {"slamgym/Explore-v1": "ExploreEnv", "slamgym/ExploreFrontiers-v1": "ExploreFrontiersEnv"}
_TO_SOURCE = re.compile(
    r"\[([^\]]+)\]\((?:\.\./)*((?:slamgym|agents|gan|tests|benchmarks|examples)/[\w/.]+)\)"
)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that no file holds."""
    pages = {
        "reference/commands.md": commands_page(),
        "reference/environments.md": environments_page(),
        "reference/api.md": api_page(),
        **{name: brought_in(ROOT / source) for source, name in BROUGHT_IN.items()},
    }
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links to sources, which the site doesn't hold, become their paths."""
    return _TO_SOURCE.sub(r"`\2`", markdown)


def brought_in(path: Path) -> str:
    """A page of the repository's top as it has to be within docs/."""
    text = path.read_text().replace("](docs/", "](").replace("](CITATION.cff)", "](faq.md#how-do-i-cite-it)")
    for source, name in BROUGHT_IN.items():
        text = text.replace(f"]({source})", f"]({name})")
    return text


def commands_page() -> str:
    """Every command with its help."""
    from slamgym.commands.help_pages import help_pages

    parts = ["# Commands\n\nWhat `--help` shows."]
    parts += [f"## slamgym {name}\n\n```text\n{page.strip()}\n```" for name, page in help_pages().items()]
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


def api_page() -> str:
    """The public names of each package, by their docstrings."""
    parts = ["# Python API"]
    for face in FACES:
        package = importlib.import_module(face)
        parts.append(f"## {face}\n\n{(inspect.getdoc(package) or '').splitlines()[0]}")
        homes = [_home(getattr(package, name), name) for name in sorted(getattr(package, "__all__", ()))]
        parts += [f"::: {home}\n    options:\n      heading_level: 3" for home in homes if home]
    return "\n\n".join(parts)


def _home(thing: Any, name: str) -> str:
    """Where a class or function is defined; empty for what is neither."""
    if not (inspect.isclass(thing) or inspect.isfunction(thing)):
        return ""
    return f"{thing.__module__}.{name}"
