"""What a worker reports when the machine, not the plan, is at fault: an error that ends the run in one line."""

import errno

import pytest
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.files import StorageError
from slamgym.dataset import DatasetConfig
from slamgym.dataset.generate import exploration as module
from slamgym.dataset.generate.exploration import ExplorationTask, run_exploration
from slamgym.dataset.record import Slot

ROOM = FloorPlan("room", box(0, 0, 2.4, 2.0))


def exploration():
    """One that gives its files back, as on another machine."""
    return ExplorationTask(Slot(0, "room", 0, 1), ROOM, None, DatasetConfig(), make_explorer)


def fail_with(error):
    def fail(*_, **__):
        raise error

    return fail


def test_a_full_temporary_folder_is_named(monkeypatch):
    monkeypatch.setenv("TMPDIR", "/scratch/tmp")
    monkeypatch.setattr(
        module, "TemporaryDirectory", fail_with(OSError(errno.ENOSPC, "No space left"))
    )
    with pytest.raises(StorageError, match=r"^/scratch/tmp: can't be written \(the disk is full"):
        run_exploration(exploration())
