"""The trials of an evaluation on disk: one JSON object a line, appended as each exploration ends.

A line is written with one call and synced, so a kill loses at most the explorations in flight. A line that
was cut short is dropped when the file is opened again.
"""

import dataclasses
import json
import os
from pathlib import Path

from slamgym.agents.evaluation.trial import Key, Trial
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_file, storage_errors


class TrialLog:
    """The trials in a file.

    Args:
        path: The file; made with the first trial.

    Raises:
        InputFileError: If the file holds something else than trials.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trials: dict[Key, Trial] = {}
        if path.exists():
            self._read()

    def append(self, trial: Trial) -> None:
        """Add a trial and wait until the disk has it.

        Raises:
            StorageError: If it can't be written.
        """
        line = json.dumps(dataclasses.asdict(trial), separators=(",", ":")) + "\n"
        with storage_errors(self.path):
            descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            try:
                os.write(descriptor, line.encode())
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        self.trials[trial.key] = trial

    def _read(self) -> None:
        content = self.path.read_bytes()
        whole, end, torn = content.rpartition(b"\n")
        if torn:
            with storage_errors(self.path):
                replace_file(self.path, whole + end)
        for number, line in enumerate(whole.split(b"\n") if whole else [], start=1):
            try:
                trial = Trial.from_dict(json.loads(line))
            except (ValueError, TypeError, ConfigError) as error:
                raise InputFileError(
                    f"{self.path}:{number}", f"is no trial of this version ({error}); move the file away"
                ) from error
            self.trials[trial.key] = trial
