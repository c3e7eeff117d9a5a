"""A small dataset among files that no command may touch, and how a command is run beside them."""

from shapely import box

from slamgym.cad import FloorPlan
from slamgym.commands.cli import main
from slamgym.dataset import DatasetConfig
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.slam import SlamConfig

SMALL = DatasetConfig(
    seed=5,
    episode=EpisodeConfig(minutes=0.1, env=ExploreConfig(slam=SlamConfig(mode="ground_truth"))),
    trajectories=2,
)


class OnePlan:
    ids = ("hall",)

    def __len__(self):
        return 1

    def load(self, plan_id):
        return FloorPlan(plan_id, box(0, 0, 4.0, 1.6))


def content_of(folder):
    """Every path below a folder, with what it is and holds."""
    return {
        str(path.relative_to(folder)): str(path.readlink())
        if path.is_symlink()
        else path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }  # fmt: skip


def run(words, place, capsys, **more):
    """Run a command; what it may not touch is compared, and its error must be one sentence."""
    kept = [place / "outside", *(path for path in (place / "kept",) if path.exists())]
    before = [content_of(folder) for folder in kept], {path.name for path in place.iterdir()}
    folders = {"dataset": place / "dataset", "out": place / "out", **more}
    code = main([word.format(**folders) for word in words])
    after = [content_of(folder) for folder in kept], {path.name for path in place.iterdir()}
    changed = {
        name
        for old, new in zip(before[0], after[0], strict=True)
        for name in old.keys() ^ new.keys()
    }
    assert after == before, f"written or removed: {sorted(changed)}"
    errors = [
        line for line in capsys.readouterr().err.splitlines() if line.startswith("slamgym: error")
    ]
    assert code in (0, 1, 2)
    assert len(errors) == (code == 2)
    return code, "".join(errors)


PLANS = ["--plans", "{plans}"]
SHORT = ["--minutes", "0.02", "--set", "slam.mode=ground_truth"]
RUNS = {
    "watch": ["watch", *PLANS, *SHORT, "--explorer", "nearest", "-o", "{out}/run/film.gif"],
    "slam": ["slam", "{episode}", "--mode", "dead_reckoning", "-o", "{out}/run"],
    "localize": ["localize", "{images}/train/B/0.png", "{episode}", "--resolution", "0.1", "-o", "{out}/run"],
    "export-log": ["export-log", "{episode}", "-o", "{out}/run/a.log.gz"],
    "dataset realism": ["dataset", "realism", "{maps}", "--against", "{robots}", "--halvings", "1",
                        "-o", "{out}/run"],
    "agents evaluate": ["agents", "evaluate", *PLANS, *SHORT, "--count", "1", "--split", "all", "--plans-filter",
                        "none", "--explorers", "nearest", "--workers", "1", "-o", "{out}/run"],
    "agents train frontiers": ["agents", "train", "frontiers", "--plan-count", "1", "--steps", "4", "--num-envs", "2",
                               "--hyperparams", "n_steps:4", "batch_size:4", "n_epochs:1",
                               "--set", "copies=2", "evaluate_every=0", "time_limit=20", "-o", "{out}/run"],
    "agents train wheels": ["agents", "train", "wheels", "--plan-count", "1", "--steps", "8", "--num-envs", "2",
                            "--hyperparams", "n_steps:4", "batch_size:4", "n_epochs:1",
                            "--set", "evaluate_every=0", "-o", "{out}/run"],
    "agents shape": ["agents", "shape", "--presets", "careful", "--seeds", "1", "--test-plans", "1", "--set",
                     "train.plan_count=1", "train.steps=4", "train.num_envs=1", "evaluate_seconds=2",
                     'train.learner.hyperparameters={{"n_steps": 4, "batch_size": 4}}', "-o", "{out}/run"],
    "gan train": ["gan", "train", "{images}", "-o", "{out}/run", "--preset", "model32-cpu", "--epochs", "1",
                  "--batch-size", "2", "--device", "cpu", "--set", "translator.input_size=32",
                  "translator.generator.width=2", "discriminator.width=8", "discriminator.patch_width=8"],
    "gan translate": ["gan", "translate", "{images}/train/B", "--weights", "{weights}", "-o", "{out}/run"],
    "gan evaluate": ["gan", "evaluate", "{images}", "--split", "train", "--pictures", "1", "-o", "{out}/run"],
}  # fmt: skip
"""Commands that read plans, maps, logs or images and write a folder or a file; each writes below ``{out}/run``."""
