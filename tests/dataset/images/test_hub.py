"""Rendered images as Hugging Face's library and Parquet readers see them."""

import json
import os
import subprocess
import sys

import pytest

from slamgym.dataset.images.format import load_images, read_images

LOAD = """
import json, sys
import numpy as np
import datasets
datasets.disable_progress_bars()
loaded = datasets.load_dataset(sys.argv[1])
rows = {
    side: [
        {"name": row["name"], "conditions": row["conditions"], "mode": row["A"].mode,
         "sums": [int(np.asarray(row[key]).sum()) for key in "AB"]}
        for row in loaded[side]
    ]
    for side in loaded
}
print(json.dumps(rows))
"""


def test_datasets_loads_the_folder_as_it_lies(images, tmp_path):
    pytest.importorskip("datasets")
    done = subprocess.run(
        [sys.executable, "-c", LOAD, str(images)],
        env=os.environ | {"HF_HOME": str(tmp_path / "home"), "HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert set(rows) == {"train", "test"}
    for side, found in rows.items():
        records = read_images(images, side)
        assert [row["name"] for row in found] == [record.name for record in records]
        for row, record in zip(found, records, strict=True):
            assert row["mode"] == "L"
            assert row["sums"] == [int(image.sum()) for image in load_images(images, record)]
            assert json.loads(row["conditions"]) == record.conditions
