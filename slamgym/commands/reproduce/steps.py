"""The steps of a reproduction: commands that a user could type, one after the other, each done once."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamgym import __version__
from slamgym.commands.reproduce.scales import Scale
from slamgym.core.config import to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.files import replace_file, write_text
from slamgym.core.progress import duration, say
from slamgym.dataset.images.format import read_images
from slamgym.gan.evaluation.generated_maps import MINIMUM

PAPER_NETWORK, OWN_NETWORK, TO_SLAM, TRAINED = "model32", "slam2cad", "modelprog", "trained"
"""Translators: the paper's from SLAM to CAD, this package's, the paper's from CAD to SLAM, and one's own."""
REDRAWN = ("parametric", "generator")
"""Methods of ``slamgym deform`` whose maps of the same plans and paths are compared with the simulated ones."""
DEFORMED = 3
"""Plans in the figures of the parametric model."""


@dataclass(frozen=True)
class Reproduction:
    """What is to be made, and where."""

    out: Path
    scale: Scale
    train: bool
    seed: int
    workers: int

    @property
    def pairs(self) -> Path:
        """The dataset."""
        return self.out / "pairs"

    @property
    def images(self) -> Path:
        """Its square images."""
        return self.out / "images"

    def settings(self) -> dict[str, Any]:
        """What decides the results, in JSON form."""
        return {"version": __version__, "train": self.train, "seed": self.seed, "scale": to_dict(self.scale)}

    def weights(self) -> list[str]:
        """Translators as ``slamgym gan evaluate --weights`` takes them."""
        trained = [f"{TRAINED}={self.out / 'run'}"] if self.train else []
        return [*trained, OWN_NETWORK, PAPER_NETWORK, TO_SLAM]


Commands = list[list[str]]


def command(*words: str | Path, **options: object) -> list[str]:
    """A command line of slamgym: words, then options by their names."""
    named = [(f"--{name.replace('_', '-')}", str(value)) for name, value in options.items()]
    return [*map(str, words), *(part for pair in named for part in pair)]


def generate_pairs(run: Reproduction) -> Commands:
    """Plans to explorations to pairs."""
    s = run.scale
    which = {
        "plans": s.plans,
        "plans_filter": s.plans_filter,
        "recipe": s.recipe,
        "trajectories": s.trajectories,
    }
    return [command("generate", **which, pairs=s.pairs, seed=run.seed, workers=run.workers, out=run.pairs)]


def clean_pairs(run: Reproduction) -> Commands:
    """Which pairs are kept, which side they are on, and their images."""
    return [
        command("dataset", "clean", run.pairs),
        command("dataset", "split", run.pairs, test=run.scale.test, seed=run.seed),
        command("dataset", "render", run.pairs, size=256, workers=run.workers, out=run.images),
        command("dataset", "stats", run.pairs),
    ]


def train_own_translator(run: Reproduction) -> Commands:
    """A translator of one's own, if wanted."""
    options = {"preset": run.scale.train_preset, "minutes": run.scale.train_minutes, "seed": run.seed}
    return [command("gan", "train", run.images, **options, out=run.out / "run")] if run.train else []


def judge_translators(run: Reproduction) -> Commands:
    """Table I, Figures 4 to 7 and 9, dimensions, two-sample tests."""
    options = {"pictures": run.scale.pictures, "repeats": run.scale.repeats, "seed": run.seed}
    line = command("gan", "evaluate", run.images, **options, out=run.out / "evaluation")
    line += ["--weights", *run.weights()]
    if len(list(read_images(run.images, "test"))) < MINIMUM:
        return [line]
    again = {method: run.out / "deformed" / method for method in REDRAWN}
    deformed = [
        [*command("deform", run.pairs, method=method, seed=run.seed, out=folder), "--overwrite"]
        for method, folder in again.items()
    ]
    return [
        *deformed,
        [*line, "--generated", *(f"{name}={path / 'episodes'}" for name, path in again.items())],
    ]


def deform_plans(run: Reproduction) -> Commands:
    """From CAD maps back to SLAM maps: Figures 7 to 9, and the times of Table II."""
    line = command("deform", "bundled", count=DEFORMED, seed=run.seed, out=run.out / "parametric")
    return [[*line, "--figures", "--overwrite"]]


def draw_maps(run: Reproduction) -> Commands:
    """Vectors with dimensions of some test maps."""
    names = [record.name for record in read_images(run.images, "test")][: run.scale.pictures]
    maps = {name: run.pairs / "episodes" / name / "map.yaml" for name in names}
    return [
        command("cad", "draw", path, formats="png,dxf", out=run.out / "drawings" / name)
        for name, path in maps.items()
    ]


def compare_explorers(run: Reproduction) -> Commands:
    """Explorers on the same plans, starts and noise."""
    s = run.scale
    which = {
        "plans": s.plans,
        "plans_filter": s.plans_filter,
        "split": s.explorer_split,
        "count": s.explorer_plans,
    }
    how = {"explorers": s.explorers, "seed": run.seed, "workers": run.workers, "out": run.out / "explorers"}
    return [[*command("agents", "evaluate", **which, **how), "--no-plot"]]


STEPS: Mapping[str, Callable[[Reproduction], Commands]] = {
    "explorations": generate_pairs,
    "cleaning": clean_pairs,
    "training": train_own_translator,
    "translators": judge_translators,
    "parametric": deform_plans,
    "drawings": draw_maps,
    "explorers": compare_explorers,
}
"""In their order; a step may read what those before it have made."""


@dataclass
class ReproductionState:
    """What is done, kept in ``state.json`` so that the same command goes on."""

    path: Path
    settings: dict[str, Any]
    steps: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By name: ``commands``, ``seconds`` and ``cpu_seconds`` of the machine's time."""

    @classmethod
    def open(cls, run: Reproduction) -> ReproductionState:
        """Read the state of a folder, or begin one.

        Raises:
            ConfigError: If the folder holds a reproduction with other settings.
        """
        path, settings = run.out / "state.json", run.settings()
        if not path.exists():
            return cls(path, settings)
        found = read_json(path, "choose another folder")
        if not isinstance(found, dict) or found.get("settings") != settings:
            raise ConfigError(f"{run.out} holds a reproduction with other settings; choose a new folder")
        return cls(path, settings, found["steps"])

    def save(self) -> None:
        """Write it, whole or not at all."""
        text = json.dumps({"settings": self.settings, "steps": self.steps}, indent=1) + "\n"
        replace_file(self.path, text.encode())


def run_steps(run: Reproduction) -> ReproductionState:
    """Run what isn't done yet.

    Raises:
        SlamgymError: If a step fails; what is done is kept.
    """
    state = ReproductionState.open(run)
    state.save()
    for number, (name, commands) in enumerate(STEPS.items(), start=1):
        if name in state.steps:
            continue
        say(f"{number} of {len(STEPS)}: {name}")
        lines = commands(run)
        began, cpu = time.monotonic(), _cpu_of_children()
        output = "".join(_run_command(name, line) for line in lines)
        write_text(run.out / "logs" / f"{name}.txt", output)
        state.steps[name] = {
            "commands": [shlex.join(["slamgym", *line]) for line in lines],
            "seconds": round(time.monotonic() - began, 1),
            "cpu_seconds": round(_cpu_of_children() - cpu, 1),
        }
        state.save()
        say(f"{name}: {duration(state.steps[name]['seconds'])}")
    return state


def _run_command(step: str, argv: list[str]) -> str:
    """Run a command in a process of its own; what it says on standard error goes to the terminal."""
    done = subprocess.run(
        [sys.executable, "-m", "slamgym", *argv], stdout=subprocess.PIPE, text=True, check=False
    )
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
