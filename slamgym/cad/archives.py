"""Archives of floor plans: read, and fetched from those who publish them, with their licence."""

import tarfile
from collections.abc import Callable
from pathlib import Path

from slamgym.cad.houseexpo import parse_houseexpo
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex, refuse_second
from slamgym.core.errors import InputFileError
from slamgym.core.files import read_text, sha256_of, write_text
from slamgym.core.limits import DOCUMENT_BYTES, ENTRIES, shown
from slamgym.core.streams import DAMAGED, download, open_expanded

HOUSEEXPO_COMMIT = "397e580a1b88bd9ada9058b3dc9a75532d38de4f"
"""The state of HouseExpo's repository that is fetched: what stands there doesn't change."""
HOUSEEXPO_URL = (
    f"https://raw.githubusercontent.com/TeaganLi/HouseExpo/{HOUSEEXPO_COMMIT}/HouseExpo/json.tar.gz"
)
HOUSEEXPO_LICENCE = (
    "HouseExpo, https://github.com/TeaganLi/HouseExpo: MIT licence, copyright (c) 2019 Tingguang Li; the "
    "plans were made from SUNCG.\nCite: T. Li et al., HouseExpo: A Large-scale 2D Indoor Layout Dataset for "
    "Learning-based Algorithms on Mobile Robots, arXiv:1903.09845, 2019."
)
"""Licence, source and paper, as the user is shown them."""
MIN_HOUSEEXPO_PLANS = 35_000
"""An archive with fewer is not the one: the paper counts 35,126 plans, the repository's page has said 35,357."""
_ID_LENGTH = 32
"""Characters of an id."""


def archived_plans(path: Path, wanted: frozenset[str] | None = None) -> PlanIndex:
    """Plans in HouseExpo's own ``.tar.gz``, which is read through once and kept as text.

    A gzip stream can't be read from the middle, so the choice is between reading 17 MB once (0.8 s for
    the 23,647 training plans, which take 60 MB) and reading on average half of it for every plan.

    Args:
        path: The archive.
        wanted: Keep only these plans.

    Raises:
        InputFileError: If it can't be read, or holds two plans of one name.
    """
    texts: dict[str, bytes] = {}
    members: dict[str, Path] = {}
    try:
        with open_expanded(path) as file, tarfile.open(fileobj=file, mode="r|") as archive:
            for number, member in enumerate(archive, start=1):
                ENTRIES.check(path, number)
                name = Path(member.name)
                if not member.isfile() or name.suffix != ".json" or name.name.startswith("."):
                    continue
                refuse_second(members, name.stem, name, path)
                members[name.stem] = name
                if wanted is None or name.stem in wanted:
                    DOCUMENT_BYTES.check(f"{path}:{shown(member.name)}", member.size)
                    content = archive.extractfile(member)
                    texts[name.stem] = content.read() if content else b""
                archive.members = []  # type: ignore[attr-defined]  # which would grow with every entry
    except (OSError, ValueError, tarfile.TarError, *DAMAGED) as error:
        raise InputFileError(
            path, f"is not a readable archive ({error}); download it again"
        ) from None
    places = {}
    for plan_id in sorted(texts):
        places[plan_id] = (texts[plan_id], f"{path}:{plan_id}.json", plan_id)
    return PlanIndex(places, parse_houseexpo)


def open_archive(path: Path, options: PlanOptions) -> PlanIndex:
    """The plans of an archive."""
    return archived_plans(path, options.wanted)


def fetch_houseexpo(
    path: Path,
    url: str | None = None,
    advance: Callable[[int, int], None] | None = None,
    sha256: str | None = None,
) -> int:
    """Download the archive of HouseExpo unless it is there, and verify it.

    Its publishers give no checksum, so the address names a commit. What is verified on the first fetch is the SHA-256,
    if it is given, and the structure: enough plans, ids of the right form, and a first plan that can be read. Its
    SHA-256 is then written next to it (``NAME.sha256``, as ``sha256sum -c`` reads it) and compared from then on.

    Args:
        path: Where it goes.
        url: Another address of the same file.
        advance: As :func:`slamgym.core.streams.download` takes it.
        sha256: What the archive must have.

    Returns:
        How many plans it holds.

    Raises:
        DownloadError: If it can't be fetched.
        InputFileError: If what arrived, or what is there, is not the archive.
    """
    if not path.exists():
        download(url or HOUSEEXPO_URL, path, advance)
    digest = sha256_of(path)
    if sha256 is not None and digest != sha256.lower():
        raise InputFileError(
            path, f"has the SHA-256 {digest}, not {shown(sha256)}; delete it and fetch it again"
        )
    source = archived_plans(path)
    has_ids = all(len(plan_id) == _ID_LENGTH for plan_id in source.ids)
    if len(source) < MIN_HOUSEEXPO_PLANS or not has_ids:
        raise InputFileError(
            path,
            f"holds {len(source)} plans and is not the public archive; delete it and fetch it again",
        )
    source.load(source.ids[0])
    sums = path.with_name(f"{path.name}.sha256")
    if not sums.exists():
        write_text(sums, f"{digest}  {path.name}\n")
    elif read_text(sums).split()[:1] != [digest]:
        raise InputFileError(
            path, f"has changed since it was fetched ({sums.name}); delete both and fetch it again"
        )
    return len(source)
