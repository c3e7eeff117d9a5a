"""What happens beside the learning: curriculum, validation, checkpoints, progress."""

import csv
import io
import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from slamgym.agents.rl.checkpoint import save_checkpoint
from slamgym.agents.rl.train_config import BEST, TrainConfig
from slamgym.agents.rl.validation import PolicyOutcome, explore_plan, mean_outcome
from slamgym.cad import FloorPlan
from slamgym.core.errors import InputFileError
from slamgym.core.files import append_line, read_text, write_text
from slamgym.core.progress import Advance
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import action_mask

VALIDATION = "validation.csv"


class FollowCurriculum(BaseCallback):
    """Moves the environments on to the next stage when it is time."""

    def __init__(self, config: TrainConfig) -> None:
        super().__init__()
        self._config = config
        self._stage = -1

    def _on_step(self) -> bool:
        stage = self._config.curriculum.stage(self.model.num_timesteps / self._config.steps)
        if stage != self._stage:
            self._stage = stage
            self.training_env.env_method("set_stage", stage)
            self.logger.record("curriculum/stage", stage)
        return True


class Validate(BaseCallback):
    """Explores validation plans now and then, and keeps the weights of the best result.

    Args:
        envs: Where to explore: the plans are dealt out to them in turns. If their loops end by a promise, the best
            weights have the least time until done, an exploration that breaks it counting twice; else the least time
            to 95 and 99 % of the floor.
        plans: What.
        every: Steps between two evaluations.
        folder: Of the run.
        export: Writes the policy to a file.
    """

    def __init__(
        self,
        envs: Sequence[ExploreFrontiersEnv],
        plans: Sequence[FloorPlan],
        every: int,
        folder: Path,
        export: Callable[[Path], None],
    ) -> None:
        super().__init__()
        self._envs, self._plans, self._every, self._folder, self._export = envs, plans, every, folder, export
        self._promise = envs[0].loop_config.promise
        rows = read_validation(folder)
        self._next = int(rows[-1]["steps"]) + every if rows else 0
        self._best = min((row["score"] for row in rows), default=float("inf"))

    def _on_step(self) -> bool:
        if self.model.num_timesteps >= self._next:
            self._next += self._every
            self._validate()
        return True

    def _on_training_end(self) -> None:
        rows = read_validation(self._folder)
        if not rows or rows[-1]["steps"] < self.model.num_timesteps:
            self._validate()

    def _validate(self) -> None:
        def choose(observation: dict[str, Any]) -> int:
            keywords = {"action_masks": action_mask(observation)} if _is_maskable(self.model) else {}
            action, _ = self.model.predict(observation, deterministic=True, **keywords)
            return int(action)

        outcomes = [
            explore_plan(self._envs[index % len(self._envs)], choose, plan, index)
            for index, plan in enumerate(self._plans)
        ]
        means = mean_outcome(outcomes)
        score = self._score(outcomes)
        for name, value in {**means, "score": score}.items():
            self.logger.record(f"validation/{name}", value)
        append_validation(self._folder, {"steps": self.model.num_timesteps, **means, "score": score})
        if score < self._best:
            self._best = score
            self._export(self._folder / BEST)

    def _score(self, outcomes: Sequence[PolicyOutcome]) -> float:
        """Seconds a plan; less is better."""
        if self._promise is None:
            return sum(outcome.time_95 + outcome.time_99 for outcome in outcomes) / len(outcomes)
        times = [
            outcome.time * (1 if self._promise.holds(outcome.coverage, plan.area) else 2)
            for outcome, plan in zip(outcomes, self._plans, strict=True)
        ]
        return sum(times) / len(times)


class SaveCheckpoints(BaseCallback):
    """Saves what the run needs to go on, between two updates."""

    def __init__(self, folder: Path, every: int) -> None:
        super().__init__()
        self._folder, self._every = folder, every
        self._next = 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.model.num_timesteps >= self._next:
            self._next = self.model.num_timesteps + self._every
            save_checkpoint(self._folder, self.model)

    def _on_training_end(self) -> None:
        save_checkpoint(self._folder, self.model)


class LogEpisodes(BaseCallback):
    """Logs means over the latest episodes of training, whatever the reward, and the CPU time so far.

    Args:
        means: What is logged, name to the key of an episode's record.
    """

    def __init__(self, means: Mapping[str, str]) -> None:
        super().__init__()
        self._means = means

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        episodes = list(self.model.ep_info_buffer or [])
        for name, key in self._means.items():
            if episodes:
                self.logger.record(name, sum(episode[key] for episode in episodes) / len(episodes))
        self.logger.record("time/cpu_seconds", time.process_time())


class ShowProgress(BaseCallback):
    """Advances a bar by the steps that were made."""

    def __init__(self, advance: Advance) -> None:
        super().__init__()
        self._advance = advance

    def _on_step(self) -> bool:
        for _ in range(self.training_env.num_envs):
            self._advance()
        return True


def read_validation(folder: Path) -> list[dict[str, float]]:
    """The evaluations of a run so far."""
    path = folder / VALIDATION
    if not path.exists():
        return []
    try:
        rows = csv.DictReader(read_text(path).splitlines())
        return [{name: float(value) for name, value in row.items()} for row in rows]
    except (TypeError, ValueError, csv.Error) as error:
        raise InputFileError(path, f"is damaged ({error}); delete it to begin it again") from None


def append_validation(folder: Path, row: Mapping[str, float]) -> None:
    """Add an evaluation to those of a run."""
    path, text = folder / VALIDATION, io.StringIO(newline="")
    writer = csv.DictWriter(text, list(row))
    if not path.exists():
        writer.writeheader()
    writer.writerow(row)
    append_line(path, text.getvalue())


def write_json(path: Path, values: Any) -> None:
    """Write JSON so that the file is whole or not there."""
    write_text(path, json.dumps(values, indent=2) + "\n")


def _is_maskable(model: Any) -> bool:
    return type(model).__name__ == "MaskablePPO"
