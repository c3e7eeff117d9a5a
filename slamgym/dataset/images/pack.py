"""Rendered images as shards that stream: WebDataset tar files, Parquet files with the pictures inside, and a card.

::

    PACK/
      README.md                    data sheet, with what the Hugging Face hub needs
      pack.json                    what it was made from
      train-000000.tar, ...        NAME.cad.png, NAME.slam.png, NAME.json of each pair (WebDataset)
      parquet/train-000000.parquet the same pairs: columns A and B (PNG bytes), the figures, conditions as JSON

The pairs of a side are shuffled by the seed, so that a program that reads the shards one after the other sees mixed
plans. Each shard is there whole or not at all; the same command continues where it stopped, and the same images and
settings give the same bytes.
"""

import hashlib
import importlib.util
import io
import json
import tarfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from slamgym import __version__
from slamgym.core.config import to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import (
    read_bytes,
    read_text,
    sha256_of,
    staged,
    storage_errors,
    write_text,
)
from slamgym.dataset.folder import claim_folder
from slamgym.dataset.format import SIDES
from slamgym.dataset.images.format import SPLITS, ImageLayout, ImageRecord, pack_card, read_images

PAIRS_PER_SHARD = 2000
"""About 30 MB at 256 px."""
SEED = 0
"""Seed of the order."""
_NO_COLUMNS = ("split", "origin", "explorer", "sha256")
"""Fields of a record that Parquet does without: by file, by pixel, among the conditions, and of the pictures."""
_KINDS = {int: "int64", float: "float64"}
"""Types of columns; all others hold text."""
_ROWS_IN_A_GROUP = 100
"""Rows of a Parquet row group, which a reader has to fetch at once."""


def pack_images(images: Path, out: Path, advance: Callable[[], None] = lambda: None) -> list[Path]:
    """Pack a folder of rendered images.

    Args:
        images: What ``slamgym dataset render`` has written.
        out: The folder of the shards.
        advance: Called after each pair.

    Returns:
        All files of shards.

    Raises:
        InputFileError: If the images are incomplete, or differ from their digests.
        ConfigError: If the folder holds other shards, or pyarrow is missing.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise ConfigError("Parquet needs pyarrow; install it by `pip install 'slamgym[hub]'`")
    layout = ImageLayout(images)
    made_from: dict[str, Any] = {"version": __version__, "images": sha256_of(layout.manifest)}
    made_from |= {
        "pairs_per_shard": PAIRS_PER_SHARD,
        "seed": SEED,
        "parquet": True,
    }  # earlier packs are continued
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    claim_folder(out / "pack.json", made_from, "shards")
    records = read_images(images)
    twice = [name for name, times in Counter(record.name for record in records).items() if times > 1]
    if twice:
        raise InputFileError(layout.manifest, f"has the name {twice[0]} twice; render the images again")
    paths = []
    for split in SPLITS:
        side = [record for record in records if record.split == split]
        order = np.random.default_rng(SEED).permutation(len(side))
        for shard, first in enumerate(range(0, len(side), PAIRS_PER_SHARD)):
            members = np.sort(order[first : first + PAIRS_PER_SHARD])
            members = np.random.default_rng([SEED, shard]).permutation(members)
            chosen = [side[place] for place in members]
            paths += _write_shard(layout, out, f"{split}-{shard:06d}", chosen, advance)
    card = pack_card(read_text(layout.card), [path.name for path in paths])
    write_text(out / "README.md", card)
    return paths


def _write_shard(
    layout: ImageLayout,
    out: Path,
    name: str,
    records: Sequence[ImageRecord],
    advance: Callable[[], None],
) -> list[Path]:
    """Write the files of a shard that aren't there yet."""
    archive, table = out / f"{name}.tar", out / "parquet" / f"{name}.parquet"
    if not (archive.exists() and table.exists()):
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
        _write_table(table, records, pictures)
    for _ in records:
        advance()
    return [archive, table]


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
