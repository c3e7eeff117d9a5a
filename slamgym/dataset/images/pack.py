"""Rendered images as shards that stream: WebDataset tar files, Parquet files with the pictures inside, and a card.

::

    PACK/
      README.md                    data sheet, with what the Hugging Face hub needs
      pack.json                    what it was made from
      train-000000.tar, ...        NAME.cad.png, NAME.slam.png, NAME.json of each pair (WebDataset)
      parquet/train-000000.parquet the same pairs: columns A and B (PNG bytes), the figures, conditions as JSON

The pairs of a side are shuffled by the seed, so that a program that reads the shards one after the other sees mixed
plans. Each shard is there whole or not at all; the same command goes on where it stopped, and the same images and
settings give the same bytes.
"""

import hashlib
import io
import json
import tarfile
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from slamgym import __version__
from slamgym.core.config import to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import (
    byte_lines,
    open_regular,
    read_bytes,
    read_text,
    replace_file,
    sha256_of,
    staged,
    write_text,
)
from slamgym.core.types import IntArray
from slamgym.dataset.format import SIDES
from slamgym.dataset.images.format import SPLITS, ImageLayout, ImageRecord, iterate_images, pack_card
from slamgym.dataset.record import require_parquet

PAIRS_PER_SHARD = 2000
"""About 30 MB at 256 px."""
SEED = 0
"""Of the order."""
_NO_COLUMNS = ("split", "origin", "explorer", "sha256")
"""Fields of a record that Parquet does without: by file, by pixel, among the conditions, and of the pictures."""
_KINDS = {int: "int64", float: "float64"}
"""Of columns; all others hold text."""
_ROWS_IN_A_GROUP = 100
"""Of Parquet: what a reader has to fetch at once."""


def pack_images(
    images: Path, out: Path, parquet: bool = True, advance: Callable[[], None] = lambda: None
) -> list[Path]:
    """Pack a folder of rendered images.

    Args:
        images: What ``slamgym dataset render`` has written.
        out: The folder of the shards.
        parquet: Also write Parquet files (needs pyarrow, extra `hub`).
        advance: Called after each pair.

    Returns:
        All files of shards.

    Raises:
        InputFileError: If the images are incomplete, or differ from their digests.
        ConfigError: If the folder holds other shards, or pyarrow is missing.
    """
    if parquet:
        require_parquet()
    layout = ImageLayout(images)
    made_from = {"version": __version__, "images": sha256_of(layout.manifest)}
    _claim(out, made_from | {"pairs_per_shard": PAIRS_PER_SHARD, "seed": SEED, "parquet": parquet})
    paths = []
    for split, starts in _starts_of_lines(layout).items():
        order = np.random.default_rng(SEED).permutation(len(starts))
        shard_of = np.empty(len(starts), dtype=np.int64)
        shard_of[order] = np.arange(len(starts)) // PAIRS_PER_SHARD
        for shard in range(-(-len(starts) // PAIRS_PER_SHARD)):
            chosen = starts[shard_of == shard]
            chosen = chosen[np.random.default_rng([SEED, shard]).permutation(len(chosen))]
            paths += _write_shard(layout, out, f"{split}-{shard:06d}", chosen, parquet, advance)
    card = pack_card(read_text(layout.card), [path.name for path in paths], parquet)
    write_text(out / "README.md", card)
    return paths


def push_to_hub(pack: Path, repository: str, private: bool) -> str:
    """Upload a pack to the Hugging Face hub; an upload that broke off goes on where it stopped.

    Args:
        pack: The folder.
        repository: ``NAME`` or ``USER/NAME``.
        private: Whether only its owner sees it.

    Returns:
        Its address.

    Raises:
        ConfigError: If ``huggingface_hub`` isn't installed, nobody is logged in, or the hub refuses.
    """
    try:
        import huggingface_hub
        from huggingface_hub.errors import HfHubHTTPError, HFValidationError, LocalTokenNotFoundError
    except ImportError:
        raise ConfigError(
            "--push-to-hub needs huggingface_hub; install it by `pip install 'slamgym[hub]'`"
        ) from None
    try:
        api = huggingface_hub.HfApi(library_name="slamgym", library_version=__version__)
        made = api.create_repo(repository, repo_type="dataset", private=private, exist_ok=True)
        api.upload_large_folder(
            repo_id=made.repo_id, folder_path=pack, repo_type="dataset", print_report=False
        )
    except (LocalTokenNotFoundError, HfHubHTTPError, HFValidationError, OSError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(
            f"{repository}: the hub refuses ({reason}); log in by `hf auth login` and try again"
        ) from None
    return str(made)


def _claim(out: Path, settings: dict[str, Any]) -> None:
    """Note what the shards are made from, or find that those that are there were made from the same."""
    path = out / "pack.json"
    if path.exists():
        if read_json(path) != settings:
            raise ConfigError(f"{out}: holds shards of other images or settings; choose a new folder")
        return
    if out.exists() and any(out.iterdir()):
        raise ConfigError(f"{out}: is not empty and holds no shards; choose a new folder")
    replace_file(path, (json.dumps(settings, indent=1) + "\n").encode())


def _starts_of_lines(layout: ImageLayout) -> dict[str, IntArray]:
    """Where the lines of each side begin in the manifest [bytes]: a million records are too many to hold."""
    starts = {split: array("q") for split in SPLITS}
    names: set[int] = set()  # their hashes: of a million, too, they take little
    at = 0
    lines = byte_lines(layout.manifest)
    for number, (record, (line, _)) in enumerate(zip(iterate_images(layout.root), lines, strict=True), 1):
        names.add(hash(record.name))
        if len(names) < number:
            raise InputFileError(
                layout.manifest, f"has the name {record.name} twice; render the images again"
            )
        starts[record.split].append(at)
        at += len(line)
    return {split: np.array(places, dtype=np.int64) for split, places in starts.items()}


def _records_at(layout: ImageLayout, starts: IntArray) -> Iterator[ImageRecord]:
    """The records whose lines begin there."""
    with open_regular(layout.manifest) as file:
        for start in starts.tolist():
            file.seek(start)
            yield ImageRecord.from_line(file.readline().decode(), str(layout.manifest))


def _write_shard(
    layout: ImageLayout,
    out: Path,
    name: str,
    starts: IntArray,
    parquet: bool,
    advance: Callable[[], None],
) -> list[Path]:
    """Write the files of a shard that aren't there yet."""
    archive, table = out / f"{name}.tar", out / "parquet" / f"{name}.parquet"
    wanted = [archive, *([table] if parquet else [])]
    if not all(path.exists() for path in wanted):
        records = list(_records_at(layout, starts))
        pictures = [_pictures(layout, record) for record in records]
        with staged(archive) as part, tarfile.open(part, "w", format=tarfile.PAX_FORMAT) as tar:
            for record, (cad, slam) in zip(records, pictures, strict=True):
                # WebDataset ends a key at its first dot.
                key = record.name.replace("%", "%25").replace(".", "%2E")
                line = json.dumps(to_dict(record)).encode()
                for ending, content in (("cad.png", cad), ("slam.png", slam), ("json", line)):
                    entry = tarfile.TarInfo(f"{key}.{ending}")
                    entry.size, entry.mode = len(content), 0o644
                    tar.addfile(entry, io.BytesIO(content))
        if parquet:
            _write_table(table, records, pictures)
    for _ in starts:
        advance()
    return wanted


def _pictures(layout: ImageLayout, record: ImageRecord) -> tuple[bytes, bytes]:
    """The PNG files of a pair, verified."""
    contents = []
    for side in SIDES:
        path = layout.image(record.split, side, record.name)
        content = read_bytes(path)
        if hashlib.sha256(content).hexdigest() != record.sha256.get(side):
            raise InputFileError(path, f"differs from its digest; run `slamgym dataset check {layout.root}`")
        contents.append(content)
    return contents[0], contents[1]


def _write_table(path: Path, records: Sequence[ImageRecord], pictures: Sequence[tuple[bytes, bytes]]) -> None:
    """One Parquet file; ``datasets`` reads A and B as images."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    hints = get_type_hints(ImageRecord)
    kinds = {
        f.name: _KINDS.get(hints[f.name], "string") for f in fields(ImageRecord) if f.name not in _NO_COLUMNS
    }
    rows: list[dict[str, Any]] = []
    for record, pair in zip(records, pictures, strict=True):
        row = {name: getattr(record, name) for name in kinds} | {"conditions": json.dumps(record.conditions)}
        named = [{"bytes": png, "path": f"{record.name}.png"} for png in pair]
        rows.append({**row, **dict(zip(SIDES, named, strict=True))})
    picture = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    columns: list[tuple[str, Any]] = [(side, picture) for side in SIDES]
    columns += [(name, pa.type_for_alias(kind)) for name, kind in kinds.items()]
    features: dict[str, dict[str, str]] = {side: {"_type": "Image"} for side in SIDES}
    features |= {name: {"dtype": kind, "_type": "Value"} for name, kind in kinds.items()}
    about = {"huggingface": json.dumps({"info": {"features": features}})}
    with staged(path) as part:
        table = pa.Table.from_pylist(rows, schema=pa.schema(columns)).replace_schema_metadata(about)
        pq.write_table(table, part, row_group_size=_ROWS_IN_A_GROUP)
