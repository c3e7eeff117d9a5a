"""What comes with the package is what its authors put there: weights, policies, models and plans by their SHA-256.

``pretrained.sha256``, in the form of ``sha256sum``, names them all; ``python -m slamgym.core.provenance`` writes it.
"""

from pathlib import Path

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_text, sha256_of, write_text

PACKAGE = Path(__file__).parents[1]
CHECKSUMS = PACKAGE / "pretrained.sha256"
_FOLDERS = (
    "cad/bundled",
    "agents/bench/v1",
    "agents/pretrained",
    "gan/pretrained",
    "planning/pretrained",
    "dataset/curate/pretrained",
)
_NOT_LISTED = (".md",)  # model cards are for people


def check_origin(path: Path | str) -> None:
    """Refuse a file of the package that differs from the one that came with it; files from elsewhere pass.

    Raises:
        InputFileError: If it differs, or isn't listed.
    """
    path = Path(path).absolute()
    if path.parent not in [PACKAGE / folder for folder in _FOLDERS]:
        return
    name = path.relative_to(PACKAGE).as_posix()
    expected = read_checksums().get(name)
    if expected is None:
        raise InputFileError(
            path,
            f"is not listed in {CHECKSUMS.name}, so it didn't come with slamgym; move it out of the package",
        )
    if sha256_of(path) != expected:
        raise InputFileError(
            path, f"is not the file that came with slamgym ({CHECKSUMS.name}); install slamgym again"
        )


def read_checksums() -> dict[str, str]:
    """SHA-256 of everything that comes with the package, by its path in it.

    Raises:
        InputFileError: If the list can't be read.
    """
    lines = (line.split(maxsplit=1) for line in read_text(CHECKSUMS).splitlines())
    return {words[1]: words[0] for words in lines if len(words) == 2}


def current_checksums() -> dict[str, str]:
    """The same as the files are now."""
    paths = [path for folder in _FOLDERS for path in (PACKAGE / folder).iterdir()]
    names = sorted(path.relative_to(PACKAGE).as_posix() for path in paths if path.suffix not in _NOT_LISTED)
    return {name: sha256_of(PACKAGE / name) for name in names}


def write_checksums() -> None:
    """List the files as they are now; for those who change them on purpose.

    Raises:
        StorageError: If the list can't be written.
    """
    write_text(CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in current_checksums().items()))


if __name__ == "__main__":
    write_checksums()
