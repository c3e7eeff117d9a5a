"""Rendered images as a dataset to publish: Parquet files or WebDataset's shards, with card, licence and checksums.

::

    PACK/
      README.md                               the images' card, with the licence and the files of each side
      LICENSE                                 its text, where one is given
      data/train-00000-of-00002.parquet       Parquet: columns A, B (pictures) and the figures of each pair; or
      data/train-00000-of-00002.tar           WebDataset: NAME.a.png, NAME.b.png, NAME.json of each pair
      SHA256SUMS                              of all of them, for ``sha256sum -c``

The pairs of a side are shuffled once, so that who reads one shard after the other sees mixed plans. The same images and
settings give the same bytes.
"""

import contextlib
import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from slamgym.core.config import to_dict
from slamgym.core.errors import InputFileError
from slamgym.core.files import (
    own_folder,
    read_bytes,
    read_text,
    sha256_of,
    storage_errors,
    temporary_name,
    write_bytes,
    write_text,
)
from slamgym.dataset.format import SIDES
from slamgym.dataset.images.format import SPLITS, ImageLayout, ImageRecord, read_images

PackKind = Literal["parquet", "webdataset"]
ENDINGS: dict[PackKind, str] = {"parquet": "parquet", "webdataset": "tar"}
ORDER_SEED = 0
"""Of the order of the pairs."""


def pack_images(
    images: Path,
    out: Path,
    kind: PackKind,
    licence: str,
    notice: Path | None = None,
    pairs_per_shard: int = 2000,
    advance: Callable[[], None] = lambda: None,
) -> dict[str, int]:
    """Pack a folder of rendered images into a new folder, which is there whole or not at all.

    Args:
        images: What ``slamgym dataset render`` has written.
        out: The folder; it must not exist, or be empty.
        kind: Format of the shards.
        licence: Name of the licence as the Hugging Face hub has it, such as ``mit``.
        notice: A file with its text.
        pairs_per_shard: Of 256 x 256 pixels, 2000 pairs take about 30 MB.
        advance: Called after each pair.

    Returns:
        Pairs of each side.

    Raises:
        InputFileError: If the images are incomplete or differ from their digests, or something is in ``out``.
        StorageError: If it can't be written.
    """
    records = read_images(images)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputFileError(out, "is not empty; name a new folder for the shards")
    text = None if notice is None else read_bytes(notice)
    layout = ImageLayout(images)
    card = read_text(layout.card)
    sides = {split: [record for record in records if record.split == split] for split in SPLITS}
    with _made_whole(out) as folder:
        own_folder(folder / "data")
        for split, side in sides.items():
            for name, chosen in _shards(split, side, pairs_per_shard):
                path = folder / "data" / f"{name}.{ENDINGS[kind]}"
                _WRITERS[kind](path, chosen, [_pictures(layout, record) for record in chosen])
                for _ in chosen:
                    advance()
        present = [split for split, side in sides.items() if side]
        write_text(folder / "README.md", _card(card, present, kind, licence))
        if text is not None:
            write_bytes(folder / "LICENSE", text)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        sums = [f"{sha256_of(path)}  {path.relative_to(folder).as_posix()}\n" for path in files]
        write_text(folder / "SHA256SUMS", "".join(sums))
    return {split: len(side) for split, side in sides.items()}


@contextlib.contextmanager
def _made_whole(out: Path) -> Iterator[Path]:
    """A folder beside ``out`` that takes its place when the block ends well, else is removed."""
    folder = temporary_name(out)
    with storage_errors(out):
        folder.mkdir(parents=True)
        try:
            yield folder
            if out.exists():
                out.rmdir()
            folder.rename(out)
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _shards(
    split: str, records: Sequence[ImageRecord], size: int
) -> Iterator[tuple[str, list[ImageRecord]]]:
    """Names of shards, and the records of each."""
    order = np.random.default_rng(ORDER_SEED).permutation(len(records)).tolist()
    firsts = range(0, len(order), size)
    for number, first in enumerate(firsts):
        chosen = [records[place] for place in order[first : first + size]]
        yield f"{split}-{number:05d}-of-{len(firsts):05d}", chosen


def _pictures(layout: ImageLayout, record: ImageRecord) -> dict[str, bytes]:
    """Both PNG files of a pair, verified by their digests."""
    found = dict[str, bytes]()
    for side in SIDES:
        path = layout.image(record.split, side, record.name)
        found[side] = read_bytes(path)
        if hashlib.sha256(found[side]).hexdigest() != record.sha256.get(side):
            raise InputFileError(path, "differs from its digest; render the images again")
    return found


def _row(record: ImageRecord) -> dict[str, Any]:
    """The figures of a pair; its conditions are JSON, since columns of a table have one type."""
    return to_dict(record) | {
        "conditions": json.dumps(record.conditions),
        "sha256": json.dumps(record.sha256),
        "origin": list(record.origin),
    }


def _write_parquet(
    path: Path, records: Sequence[ImageRecord], pictures: Sequence[dict[str, bytes]]
) -> None:
    """A table that ``datasets`` reads with its pictures."""
    import datasets

    datasets.disable_progress_bars()
    rows = []
    for record, pair in zip(records, pictures, strict=True):
        named = {side: {"bytes": png, "path": f"{record.name}.png"} for side, png in pair.items()}
        rows.append(named | _row(record))
    table = datasets.Dataset.from_list(rows)
    features = table.features.copy()
    features.update({side: datasets.Image() for side in SIDES})
    table.cast(features).to_parquet(str(path))


def _write_webdataset(
    path: Path, records: Sequence[ImageRecord], pictures: Sequence[dict[str, bytes]]
) -> None:
    """An archive that ``webdataset`` streams."""
    import webdataset

    with webdataset.TarWriter(str(path), mtime=0.0) as writer:
        for record, pair in zip(records, pictures, strict=True):
            # A key ends at its first dot.
            key = record.name.replace("%", "%25").replace(".", "%2E")
            named = {f"{side.lower()}.png": png for side, png in pair.items()}
            line = json.dumps(to_dict(record)).encode()
            writer.write({"__key__": key, **named, "json": line})


_WRITERS = {"parquet": _write_parquet, "webdataset": _write_webdataset}


def _card(card: str, present: Sequence[str], kind: PackKind, licence: str) -> str:
    """The images' card for the shards."""
    _, head, body = card.split("---\n", 2)
    about = yaml.safe_load(head) | {"license": licence}
    paths = [{"split": split, "path": f"data/{split}-*"} for split in present]
    about["configs"] = [{"config_name": "default", "data_files": paths}]
    before, _, after = body.partition("## Files\n")
    closing = after.rpartition("```\n")[2].strip()
    if kind == "parquet":
        content = "`A`, `B` (pictures) and the figures of each pair, `conditions` as JSON"
        load = '    load_dataset("parquet", data_files="data/train-*.parquet")'
    else:
        content = "`NAME.a.png`, `NAME.b.png` and `NAME.json` of each pair (WebDataset)"
        load = '    load_dataset("webdataset", data_files="data/train-*.tar", streaming=True)'
    files = f"`data/SIDE-*.{ENDINGS[kind]}`: {content}. `sha256sum -c SHA256SUMS` checks all files."
    parts = [files, f"    from datasets import load_dataset\n\n{load}", closing]
    dumped = yaml.safe_dump(about, sort_keys=False)
    return f"---\n{dumped}---\n{before}## Files\n\n" + "\n\n".join(parts) + "\n"
