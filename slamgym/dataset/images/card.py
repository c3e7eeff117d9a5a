"""What makes folders of images and packs datasets of the Hugging Face hub: their cards, and the metadata of images.

``datasets.load_dataset(IMAGES)`` finds the image-folder builder by the files, the two sides by the head of
``README.md``, and the two pictures of a row by the ``*_file_name`` columns of each side's ``metadata.jsonl``.
"""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slamgym import __version__
from slamgym.core.files import replace_file
from slamgym.core.text import markdown
from slamgym.dataset.faults import MapFault
from slamgym.dataset.format import SIDES
from slamgym.dataset.images.format import METADATA, SPLITS, ImageLayout, ImageRecord
from slamgym.dataset.record import rows_of

_READING = """\
## Reading

Every tar file is a WebDataset shard (`NAME.cad.png`, `NAME.slam.png`, `NAME.json`); every Parquet file holds the same
pairs. The sides are split by floor plan.

```python
from datasets import load_dataset

pairs = load_dataset("PACK", streaming=True)  # this folder, or its name on the hub
first = next(iter(pairs["train"]))
first["A"], first["B"], first["metres_per_px"]
shards = load_dataset("webdataset", data_files={"train": "PACK/train-*.tar"}, streaming=True)
next(iter(shards["train"]))["cad.png"]
```

## Known faults

The SLAM maps are simulated. What tells them from maps of robots is measured in slamgym's docs/realism.md; pairs whose
maps are incomplete or bent too much were left out.
"""


def write_card(
    layout: ImageLayout,
    records: Sequence[ImageRecord],
    left_out: Mapping[str, MapFault],
    settings: Mapping[str, Any],
    source: str,
) -> None:
    """Write ``README.md`` and both ``metadata.jsonl``.

    Args:
        layout: The folder.
        records: Its pairs.
        left_out: Pairs of the dataset that have no images, and why.
        settings: The content of ``config.json``.
        source: SHA-256 of the manifest of the dataset that the images were made from.
    """
    rows = rows_of(records)
    for split in SPLITS:
        lines = [
            json.dumps({**{f"{side}_file_name": f"{side}/{row['name']}.png" for side in SIDES}, **row}) + "\n"
            for row in rows
            if row["split"] == split
        ]
        replace_file(layout.root / split / METADATA, "".join(lines).encode())
    replace_file(layout.card, _card(records, left_out, settings, source).encode())


def _card(
    records: Sequence[ImageRecord], left_out: Mapping[str, MapFault], settings: Mapping[str, Any], source: str
) -> str:
    import yaml

    present = [split for split in SPLITS if any(record.split == split for record in records)]
    head = {
        "pretty_name": "SLAM/CAD map pairs",
        "task_categories": ["image-to-image"],
        "tags": ["slam", "floor-plans", "occupancy-grids"],
        "size_categories": [_size_category(len(records))],
        "configs": [
            {
                "config_name": "default",
                "drop_labels": True,
                "data_files": [{"split": split, "path": f"{split}/**"} for split in present],
            }
        ],
    }
    headings = ("side", "pairs", "plans", "coverage, median", "position error, median")
    table = markdown(headings, [_side_row([r for r in records if r.split == s], s) for s in SPLITS])
    images = settings["images"]
    reasons = Counter(fault.reason for fault in left_out.values())
    missing = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common()) or "none"
    scale = (
        "each pair has a scale of its own, so that both maps together fill the image"
        if images["scaling"] == "fit"
        else f"all pairs have {images['metres_per_px']:g} m per pixel"
    )
    return f"""---
{yaml.safe_dump(head, sort_keys=False).strip()}
---

# SLAM/CAD map pairs

Pairs of images of one place in one frame: `A` is the CAD map (0 walls and outside, 254 inside), `B` the map that a
simulated robot made by SLAM while it explored the building (0 occupied, 205 unknown, 254 free). Made by
slamgym {__version__} from a dataset whose manifest has the SHA-256 `{source}`.

All images are {images["size"]} x {images["size"]} pixels, one channel of 8 bits; {scale} (`metres_per_px`).

{table}
The sides are split by floor plan, and plans that look alike are on one side. Pairs left out: {missing}.

## Files

| file | content |
|---|---|
| `{{train,test}}/{{A,B}}/<name>.png` | the images; the two of a pair have the same name |
| `manifest.jsonl` | one line per pair: plan, seed, conditions, scale, errors, SHA-256 of both images |
| `{{train,test}}/metadata.jsonl` | the same for `datasets` |
| `config.json` | how the images were made |
| `skipped.jsonl` | pairs of the dataset that have no images, and why |

```python
from datasets import load_dataset

pairs = load_dataset("IMAGES")          # this folder
pairs["train"][0]["A"], pairs["train"][0]["B"]
```

Plan ids name floor plans of the sources the dataset was made from, whose licences apply to what is drawn from them.
"""


def _side_row(records: Sequence[ImageRecord], split: str) -> tuple[str, ...]:
    if not records:
        return split, "0", "0", "-", "-"
    coverage, error = (
        np.median([getattr(record, name) for record in records]) for name in ("coverage", "ate")
    )
    plans = {record.plan_id for record in records}
    return split, str(len(records)), str(len(plans)), f"{100.0 * coverage:.1f} %", f"{error:.3f} m"


def _size_category(count: int) -> str:
    """The hub's name for a number of rows."""
    bounds = [(1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M")]
    return next((name for bound, name in bounds if count < bound), "1M<n<10M")


def pack_card(images_card: str, names: Sequence[str], parquet: bool) -> str:
    """The card of the images with the shards in its head, and how to read them instead of the list of files.

    Args:
        images_card: The content of the images' ``README.md``.
        names: Of the shards' files.
        parquet: Let the hub read the Parquet files rather than the tar files.
    """
    import yaml

    _, head_text, body = images_card.split("---\n", 2)
    head = yaml.safe_load(head_text)
    splits = [split for split in SPLITS if any(name.startswith(f"{split}-") for name in names)]
    place = "parquet/{}-*.parquet" if parquet else "{}-*.tar"
    files = [{"split": split, "path": place.format(split)} for split in splits]
    head["configs"] = [{"config_name": "default", "data_files": files}]
    body = re.sub(r"^## Files\n.*?^```.*?^```\n", "", body, flags=re.MULTILINE | re.DOTALL)
    return f"---\n{yaml.safe_dump(head, sort_keys=False).strip()}\n---\n{body.rstrip()}\n\n{_READING}"
