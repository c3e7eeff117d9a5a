"""Where trainings compute."""

import platform
import subprocess
import sys

import pytest

PAGES_TAKEN = """
import resource, sys
import torch
from slamgym.gan.device import keep_freed_memory

if sys.argv[1] == "kept":
    keep_freed_memory()
for step in range(12):
    if step == 2:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    tensors = [torch.ones(4 << 20) for _ in range(3)]
    del tensors
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
def test_freed_tensors_need_no_new_pages():
    given_back, kept = (
        int(subprocess.run([sys.executable, "-c", PAGES_TAKEN, how], capture_output=True, check=True).stdout)
        for how in ("given back", "kept")
    )
    assert kept < 0.1 * given_back
