"""Proof that weights, policies, models and plans of the package are those that its authors put there, by SHA-256.

``pretrained.sha256``, in the form of ``sha256sum``, names them all; ``python -m slamgym.core.provenance`` writes it.
"""

from pathlib import Path

import slamgym
from slamgym.core.errors import InputFileError
from slamgym.core.files import read_text, sha256_of, write_text

CHECKSUMS = Path(__file__).parents[1] / "pretrained.sha256"
_FOLDERS = (
    "cad/bundled",
    "agents/bench/frozen",
    "agents/pretrained",
    "gan/pretrained",
    "planning/pretrained",
    "dataset/curate/pretrained",
    "drawing/pretrained",
)
_NOT_LISTED = (".md",)  # model cards are for people


def check_origin(path: Path | str) -> None:
    """Refuse a file of the package that differs from the one that came with it; files from elsewhere pass.

    Raises:
        InputFileError: If it differs, or isn't listed.
    """
    path = Path(path).absolute()
    homes = {home_of(folder): folder for folder in _FOLDERS}
    if path.parent not in homes:
        return
    name = f"{homes[path.parent]}/{path.name}"
    expected = read_checksums().get(name)
    if expected is None:
        raise InputFileError(
            path,
            f"is not listed in {CHECKSUMS.name}, so it didn't come with slamgym; move it out of the package",
        )
    if sha256_of(path) != expected:
        raise InputFileError(
            path,
            f"is not the file that came with slamgym ({CHECKSUMS.name}); install slamgym again",
        )


def home_of(name: str) -> Path:
    """Where a folder of the package lies; in a checkout, ``agents`` and ``gan`` lie next to the package."""
    homes = [Path(part) / name for part in slamgym.__path__]
    return next((home for home in homes if home.exists()), homes[0])


def read_checksums() -> dict[str, str]:
    """SHA-256 of everything that comes with the package, by its path in it.

    Raises:
        InputFileError: If the list can't be read.
    """
    lines = (line.split(maxsplit=1) for line in read_text(CHECKSUMS).splitlines())
    return {words[1]: words[0] for words in lines if len(words) == 2}


def current_checksums() -> dict[str, str]:
    """The same as the files are now."""
    paths = {f"{name}/{path.name}": path for name in _FOLDERS for path in home_of(name).iterdir()}
    return {
        name: sha256_of(paths[name])
        for name in sorted(paths)
        if paths[name].suffix not in _NOT_LISTED
    }


def write_checksums() -> None:
    """List the files as they are now; for those who change them on purpose.

    Raises:
        StorageError: If the list can't be written.
    """
    write_text(
        CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in current_checksums().items())
    )


if __name__ == "__main__":
    write_checksums()
