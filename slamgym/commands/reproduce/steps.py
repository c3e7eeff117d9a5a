"""The steps of a reproduction: commands that a user could type, one after the other, each done once."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slamgym import __version__
from slamgym.core.config import changed_settings
from slamgym.core.documents import json_text, parse_yaml, read_json
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.files import read_text, replace_file, write_text
from slamgym.core.progress import duration, say

PAPER_NETWORK = "model32"
"""The paper's translator from SLAM to CAD."""
OWN_NETWORK = "slam2cad"
"""This package's translator from SLAM to CAD."""
TO_SLAM = "modelprog"
"""The paper's translator from CAD to SLAM."""
TRAINED = {network: f"trained_{network}" for network in (PAPER_NETWORK, OWN_NETWORK, TO_SLAM)}
"""Names of the networks that the reproduction itself trains, by those of the pretrained ones."""
PARAMETRIC = "parametric"
"""Method of ``slamgym deform``: the paper's parametric model."""
REDRAWN = (PARAMETRIC, "generator")
"""Methods of ``slamgym deform`` whose maps of the same plans and paths are compared with the simulated ones."""


def _read(name: str) -> Any:
    path = Path(__file__).with_name(name)
    return parse_yaml(read_text(path), path)


REPRODUCTION_SCALES: dict[str, dict[str, Any]] = _read("scales.yaml")
STEPS: dict[str, list[str]] = _read("steps.yaml")


class Reproduction:
    """A reproduction and its state; ``state.json`` keeps it so that the same command resumes.

    Args:
        out: Folder of everything.
        scale: How large.
        train: Also train a translator.
        seed: Of everything random.
        workers: Processes.

    Raises:
        ConfigError: If the folder holds a reproduction with other settings.
    """

    def __init__(
        self, out: Path, scale: Mapping[str, Any], train: bool, seed: int, workers: int
    ) -> None:
        self.out = out
        self.scale = scale
        self.train = train
        self.seed = seed
        # Where nothing is trained, all maps are for testing.
        test = scale["test"] if train else 1.0
        self._words = {**scale, "test": test, "seed": seed, "workers": workers, "out": out}
        self._settings = {
            "version": __version__,
            "train": train,
            "seed": seed,
            "scale": dict(scale),
        }
        self._state = out / "state.json"
        self.steps: dict[str, dict[str, Any]] = {}
        """By name: ``commands``, ``seconds`` and ``cpu_seconds`` of the machine's time."""
        if self._state.exists():
            found = read_json(self._state, "choose another folder")
            before = found.get("settings", {}) if isinstance(found, dict) else {}
            changes = changed_settings(before, self._settings)
            if changes:
                raise ConfigError(
                    f"{out} holds a reproduction with other settings ({changes}); choose a new folder"
                )
            self.steps = found["steps"]

    def commands(self, step: str) -> list[list[str]]:
        """The commands of a step, word by word."""
        lines = [[word.format_map(self._words) for word in line.split()] for line in STEPS[step]]
        if step == "training" and not self.train:
            return []
        if step == "drawings":
            shown = self._test_names()[: self.scale["pictures"]]
            return [lines[0] + [f"{self.out}/pairs/episodes/{name}/map.yaml" for name in shown]]
        if step == "table_one":
            lines[-1] += self._trained(PAPER_NETWORK, OWN_NETWORK)
        if step == "translators":
            return self._comparison(lines)
        return lines

    def _comparison(self, lines: list[list[str]]) -> list[list[str]]:
        """The commands of the step ``translators``; of few maps those that draw the way back are left out."""
        from slamgym.dataset.realism.comparison import MIN_MAPS

        evaluate = lines[-1] + self._trained(OWN_NETWORK)
        if len(self._test_names()) < MIN_MAPS:
            return [evaluate]
        redrawn = [f"{method}={self.out / 'redrawn' / method / 'episodes'}" for method in REDRAWN]
        evaluate += [TO_SLAM, *self._trained(TO_SLAM), "--generated", *redrawn]
        return [*lines[:-1], evaluate]

    def _test_names(self) -> list[str]:
        """Names of the test maps."""
        from slamgym.dataset.images.format import read_images

        return [record.name for record in read_images(self.out / "images", "test")]

    def _trained(self, *networks: str) -> list[str]:
        """Those of the networks that this run trains, as ``NAME=FOLDER``."""
        if not self.train:
            return []
        return [f"{TRAINED[network]}={self.out / 'runs' / network}" for network in networks]

    def run_steps(self) -> None:
        """Run what isn't done yet.

        Raises:
            SlamgymError: If a step fails; what is done is kept.
        """
        for number, name in enumerate(STEPS, start=1):
            self._save()
            if name in self.steps:
                continue
            say(f"{number} of {len(STEPS)}: {name}")
            lines = self.commands(name)
            began = time.monotonic()
            cpu_before = _cpu_of_children()
            output = "".join(_run_command(name, line) for line in lines)
            write_text(self.out / "logs" / f"{name}.txt", output)
            self.steps[name] = {
                "commands": [shlex.join(["slamgym", *line]) for line in lines],
                "seconds": round(time.monotonic() - began, 1),
                "cpu_seconds": round(_cpu_of_children() - cpu_before, 1),
            }
            say(f"{name}: {duration(self.steps[name]['seconds'])}")
        self._save()

    def _save(self) -> None:
        text = json_text({"settings": self._settings, "steps": self.steps})
        replace_file(self._state, text.encode())


def _run_command(step: str, argv: list[str]) -> str:
    """Run a command in a separate process; what it says on standard error goes to the terminal."""
    whole = [sys.executable, "-m", "slamgym", *argv]
    done = subprocess.run(whole, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise SlamgymError(
            f"the step {step!r} failed: {shlex.join(['slamgym', *argv])} ended with status {done.returncode}; put it "
            "right and run the same command again"
        )
    return done.stdout


def _cpu_of_children() -> float:
    """CPU time of processes that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system
