"""Manifests as tables: rows of which each column has one type, and Parquet files of them."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from slamgym.core.config import to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.staged import staged
from slamgym.dataset.format import PairRecord
from slamgym.dataset.images.format import ImageRecord


def rows_of(records: Sequence[PairRecord] | Sequence[ImageRecord]) -> list[dict[str, Any]]:
    """The records as rows of plain values; every row has every condition, null where it has none.

    Conditions differ between records, and a setting may be a word here and a number there; a column of a
    table can't be both, so such a column holds text.
    """
    rows = [to_dict(record) for record in records]
    names = sorted({name for row in rows for name in row["conditions"]})
    kinds = {name: _common_kind([row["conditions"].get(name) for row in rows]) for name in names}
    for row in rows:
        drawn = row["conditions"]
        row["conditions"] = {
            name: None if drawn.get(name) is None else kinds[name](drawn[name]) for name in names
        }
    return rows


def require_parquet() -> None:
    """Find out that Parquet can't be written before the work is done, rather than after.

    Raises:
        ConfigError: If pyarrow isn't installed.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise ConfigError("Parquet needs pyarrow; install it by `pip install 'slamgym[hub]'`")


def write_parquet(path: Path, records: Sequence[PairRecord] | Sequence[ImageRecord]) -> None:
    """Write a manifest as a Parquet file.

    Raises:
        ConfigError: If pyarrow isn't installed.
        InputFileError: If the file can't be written.
    """
    require_parquet()
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.Table.from_pylist(rows_of(records))
    with staged(path) as part:
        pq.write_table(table, part)


def _common_kind(values: Sequence[Any]) -> type:
    """The type that holds all values: whole numbers and others are numbers, anything else mixed is text."""
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) == 1:
        return kinds.pop()
    return float if kinds <= {int, float} else str
