"""What is a choice of a frontier worth? Choices are tried from the same state, with the same noise, to the end.

    python benchmarks/exploring/decision_values.py [--homes 300]

The policy that comes with the package explores validation homes of its training, at known poses along paths. At a fifth
of its decisions the environment is copied for each of up to six choices: its three best, those of ``tour`` and
``nearest``, another one at random, and *done*; each copy goes on by the policy (rollouts; Tesauro and Galperin 1996).
*seconds saved*: return against the policy's own choice, in seconds of robot time, a hundredth of the floor that is
missing below 98 % counting 150. *trees* choose by a regression of these seconds on the observation's figures, or say
*done* where a classifier is sure by nine tenths; both learned from decisions in other homes.
"""

import copy
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from sklearn.ensemble import HistGradientBoostingClassifier, HistGradientBoostingRegressor
from sklearn.model_selection import GroupKFold

from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.pretrained_policy import FRONTIER_POLICY, read_policy
from slamgym.agents.rl.environments import make_env
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.agents.scoring import FrontierScorer
from slamgym.core.intervals import mean_interval
from slamgym.core.types import BoolArray, FloatArray, IntArray, Observation
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES
from slamgym.sim import ClutterConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents", "slamgym/envs", "slamgym/planning")
"""What is measured."""
SHARE = 0.2
"""At this share of the decisions all choices are tried."""
LARGEST_SAVING = 150.0
"""Trees learn from savings and losses up to this [s]: a missed room would outweigh all else."""
FOLDS = 10
SURE = 0.9
"""*Done* is said where it is better with this probability."""
PRICE = TrainConfig().reward.time
"""What a second costs in the reward of trainings."""
PATH = CANDIDATE_FEATURES.index("path_length")
DETOUR = CANDIDATE_FEATURES.index("tour_detour")


@dataclass(frozen=True)
class Arguments:
    """Try all choices."""

    homes: int = 300
    """Explorations, each of another home."""
    seed: int = 0
    """Decides homes, starts and choices."""


@dataclass
class Decision:
    """A decision, and what each tried choice led to."""

    home: int
    observation: Observation  # of the frontiers alone
    policy: int
    tried: list[int]
    returns: list[float]
    done: float | None  # return of *done*, where it could be said

    @property
    def savings(self) -> FloatArray:
        """Seconds that each tried choice saves, shape (tried,)."""
        return self.seconds(np.array(self.returns))

    @property
    def base(self) -> int:
        """Which of the tried choices is the policy's."""
        return self.tried.index(self.policy)

    def seconds(self, returns: Any) -> Any:
        """Returns, as seconds saved against the policy's choice."""
        return (returns - self.returns[self.base]) / PRICE

    def rank(self, scores: FloatArray) -> int:
        """Which of the tried choices has the highest score; scores of all frontiers, shape (N,)."""
        return int(np.argmax(scores[self.tried]))


def main() -> None:
    arguments = tyro.cli(Arguments)
    decisions = try_choices(arguments)
    homes = np.array([one.home for one in decisions])
    chosen = {
        "`tour`": [one.rank(tour_scores(one.observation)) for one in decisions],
        "`nearest`": [one.rank(-one.observation["frontiers"][:, PATH]) for one in decisions],
        "trees": by_trees(decisions, homes),
        "the best in hindsight": [int(np.argmax(one.returns)) for one in decisions],
    }
    rows = [row_of(name, decisions, homes, ranks) for name, ranks in chosen.items()]
    rows += rows_of_done([one for one in decisions if one.done is not None])
    title = f"{len(decisions)} decisions in {len(set(homes.tolist()))} homes"
    print_and_save("exploring/decision_values", title, rows, list(rows[0]), MODULES)


def try_choices(arguments: Arguments) -> list[Decision]:
    """Explore homes, and try the choices at some decisions of each."""
    config = TrainConfig()
    rng = np.random.default_rng(arguments.seed)
    drawn = draw_plans(config.plans, "validation", 2 * arguments.homes)
    plans = [plan for plan in drawn if plan.area <= config.largest_area][: arguments.homes]
    scorer = FrontierScorer(read_policy(FRONTIER_POLICY)[0])
    decisions: list[Decision] = []
    for home, plan in enumerate(plans):
        env = make_env(config, [plan], ClutterConfig())
        observation, _ = env.reset(seed=int(rng.integers(1 << 31)))
        is_over = False
        while not is_over:
            if observation["mask"].sum() > 1 and rng.random() < SHARE:
                decisions.append(tried(env, home, only_frontiers(observation), scorer, rng))
            observation, _, terminated, truncated, _ = env.step(best(scorer, observation))
            is_over = terminated or truncated
        print(f"{home + 1}/{len(plans)} homes, {len(decisions)} decisions", file=sys.stderr)
    return decisions


def only_frontiers(observation: Observation) -> Observation:
    """An observation without the rows that hold no frontier."""
    count = int(observation["mask"].sum())
    return {
        "frontiers": observation["frontiers"][:count].copy(),
        "mask": observation["mask"][:count].copy(),
        "lengths": observation["lengths"][: count + 1, : count + 1].copy(),
        "globals": observation["globals"].copy(),
    }


def best(scorer: FrontierScorer, observation: Observation) -> int:
    """The policy's choice; 0 if there is nothing to choose."""
    return int(np.argmax(scorer.decide(observation).scores)) if observation["mask"].any() else 0


def tour_scores(frontiers: Observation) -> FloatArray:
    """Scores of the rule ``tour``, of equals the nearest first, shape (N,)."""
    figures = frontiers["frontiers"]
    return -(1000.0 * figures[:, DETOUR] + figures[:, PATH])


def tried(
    env: ExploreFrontiersEnv,
    home: int,
    frontiers: Observation,
    scorer: FrontierScorer,
    rng: np.random.Generator,
) -> Decision:
    """Try choices from here to the end."""
    scores = scorer.decide(frontiers).scores
    candidates = np.argsort(-scores)[:3].tolist()
    candidates.append(int(np.argmax(tour_scores(frontiers))))
    candidates.append(int(np.argmin(frontiers["frontiers"][:, PATH])))
    candidates.append(int(rng.integers(len(scores))))
    choices = list(dict.fromkeys(candidates))
    returns = [rollout(env, choice, scorer) for choice in choices]
    last = len(env.action_masks()) - 1
    done = rollout(env, last, scorer) if env.loop.may_stop else None
    return Decision(home, frontiers, choices[0], choices, returns, done)


def rollout(env: ExploreFrontiersEnv, action: int, scorer: FrontierScorer) -> float:
    """Return of an action in a copy of the environment, which goes on by the policy."""
    one = copy.deepcopy(env)
    total = 0.0
    is_over = False
    while not is_over:
        observation, reward, terminated, truncated, _ = one.step(action)
        total += reward
        is_over = terminated or truncated
        action = best(scorer, observation)
    return total


def by_trees(decisions: list[Decision], homes: IntArray) -> list[int]:
    """Choices by trees that learned what choices save from decisions in other homes."""
    inputs = [choice_figures(one) for one in decisions]
    savings = [np.clip(one.savings, -LARGEST_SAVING, LARGEST_SAVING) for one in decisions]
    ranks = np.zeros(len(decisions), np.int64)
    for learned, left_out in GroupKFold(FOLDS).split(homes, groups=homes):
        trees = HistGradientBoostingRegressor(
            max_iter=60, learning_rate=0.05, max_leaf_nodes=8, min_samples_leaf=60
        )
        trees.fit(
            np.concatenate([inputs[i] for i in learned]),
            np.concatenate([savings[i] for i in learned]),
        )
        for i in left_out:
            ranks[i] = int(np.argmax(trees.predict(inputs[i])))
    return ranks.tolist()


def choice_figures(one: Decision) -> FloatArray:
    """What trees know of each tried choice, shape (tried, figures): its figures, and against the policy's choice."""
    figures = one.observation["frontiers"]
    own = figures[one.tried]
    overall = np.repeat(one.observation["globals"][np.newaxis], len(one.tried), axis=0)
    return np.hstack([own, own - figures[one.policy], overall])


def row_of(
    name: str, decisions: list[Decision], homes: IntArray, ranks: list[int]
) -> dict[str, Any]:
    """What choosing so saves."""
    pairs = list(zip(decisions, ranks, strict=True))
    saved = np.array([one.savings[rank] for one, rank in pairs])
    others = np.array([rank != one.base for one, rank in pairs])
    return figures_of(name, saved, others, homes)


def rows_of_done(decisions: list[Decision]) -> list[dict[str, Any]]:
    """What *done* saves: everywhere, where trees are sure, and where it does in hindsight."""
    homes = np.array([one.home for one in decisions])
    saved = np.array([one.seconds(one.done) for one in decisions])
    inputs = np.array([state_figures(one) for one in decisions])
    chances = np.zeros(len(saved))
    for learned, left_out in GroupKFold(FOLDS).split(inputs, groups=homes):
        trees = HistGradientBoostingClassifier(
            max_iter=150, learning_rate=0.05, max_leaf_nodes=8, min_samples_leaf=20
        )
        trees.fit(inputs[learned], saved[learned] > 0.0)
        chances[left_out] = trees.predict_proba(inputs[left_out])[:, 1]
    said: dict[str, BoolArray] = {
        "*done*, where trees are sure": chances > SURE,
        "*done*, in hindsight": saved > 0.0,
    }
    return [figures_of(name, saved * is_said, is_said, homes) for name, is_said in said.items()]


def state_figures(one: Decision) -> FloatArray:
    """What trees know of a decision: sums, largest and least figures of the frontiers, and those of the map."""
    figures = one.observation["frontiers"]
    parts = [figures.sum(axis=0), figures.max(axis=0), figures.min(axis=0)]
    return np.concatenate([*parts, one.observation["globals"], [len(figures)]])


def figures_of(name: str, saved: FloatArray, others: BoolArray, homes: IntArray) -> dict[str, Any]:
    """A row of the table; intervals over homes."""
    return {
        "choice": name,
        "decisions": len(saved),
        "another than the policy's [%]": round(100.0 * float(others.mean()), 1),
        "seconds saved": with_bounds(mean_interval(saved, groups=homes)),
    }


if __name__ == "__main__":
    main()
