"""``slamgym generate``: explore floor plans and write map pairs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgym.cad.plan_filter import PlanFilter
from slamgym.cad.plan_formats import PLANS_HELP
from slamgym.commands.frame import Out
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Count, CountOrZero, Positive, Seed
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import TASK_TIMEOUT, available_cores
from slamgym.core.parallel.engine import EngineName, Execution
from slamgym.core.progress import counted, duration, say, tell
from slamgym.dataset.format import WHOLE, Shard

if TYPE_CHECKING:
    from slamgym.dataset.generate.build import BuildReport
    from slamgym.dataset.generate.recipe import DatasetConfig


SEVERAL_PLANS_HELP = (
    f"{PLANS_HELP} May be given several times or with commas; ``=WEIGHT`` behind a source makes it come more often, as "
    "in ``json.tar.gz=8``. By default ``bundled``."
)
"""What the option --plans takes."""


class GenerateArguments(Arguments):
    """Explore floor plans with a simulated robot and write SLAM/CAD map pairs.

    The same seed gives the same files with any number of workers. Ctrl-C and even kill -9 lose at most the
    explorations in flight: the same command again makes the rest.
    """

    out: Out
    """Folder of the dataset; made if it is missing, continued if it holds one made with the same settings."""
    plans: Annotated[
        tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(help=SEVERAL_PLANS_HELP)
    ] = ()
    ids: Path | None = None
    """A file with one plan id a line: take only these plans."""
    layers: tuple[str, ...] = ()
    """Layers of the walls of DXF drawings, where their names don't say it."""
    plans_filter: PlanFilter | None = None
    """``useful`` takes homes that are worth exploring: 2-20 rooms, 20-300 m2, at most 30 m long, at most
    1,500 vertices; generated plans always pass. By default ``none``: all."""
    pairs: Count = 8
    """Number of pairs that the folder shall hold. A larger number later adds to the same folder."""
    explorer: str | None = None
    """Who drives: ``rl``, the trained one, by default; ``explore_lite``, ``nearest``, ... (docs/explorers.md compares
    them)."""
    minutes: Literal["auto"] | Positive | None = None
    """``auto``, the default: until nothing is left to explore, with a limit that grows with the floor area; or a fixed
    limit of robot time [min], 7 in the paper."""
    seed: Seed | None = None
    """Seed of everything random, by default 0."""
    recipe: str | None = None
    """Vary the settings from one exploration to the next: a YAML or JSON file, ``reference`` or
    ``quick``."""
    trajectories: Count | None = None
    """Explorations of each plan that come one after the other: several SLAM maps of one CAD map; by default 1."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""
    engine: EngineName = "local"
    """``local``: the processes of this machine. ``ray``: a Ray cluster (``pip install 'slamgym[ray]'``).
    ``in_process``: this process, for debugging: a crash ends the run."""
    address: str | None = None
    """Address of the Ray cluster, e.g. ``auto``; by default that of ``RAY_ADDRESS``."""
    task_timeout: Positive = TASK_TIMEOUT
    """Longest wall time of an exploration [s]; one that hangs is ended and noted in ``rejected.jsonl``."""
    shard: str | None = None
    """``i/n``, e.g. 3/10: make only the fourth tenth of the dataset, in a separate folder below OUT. When
    all shards are done, ``slamgym dataset merge OUT`` puts them together."""
    images: Path | None = None
    """Also render uniform square images of the complete pairs into this folder, by the defaults of
    ``slamgym dataset render``."""
    settings: AllSettings = SettingsOptions()
    """Robot, sensors, SLAM, furniture and people, the images and all else. ``--set robots=2``: so many explore each
    building together, for one merged map a pair; path and log are those of the first robot."""


def main(arguments: GenerateArguments) -> None:
    """Run the command."""
    from slamgym.agents.registry import make_explorer
    from slamgym.cad import open_plan_mix
    from slamgym.commands.dataset.render import render_and_report
    from slamgym.dataset.generate.build import build_dataset
    from slamgym.dataset.images.square_images import ImageConfig

    if arguments.shard is not None and arguments.images is not None:
        raise ConfigError(
            "a shard alone is not rendered; leave --images out and render after the merge"
        )
    config = dataset_config(arguments)
    shard = WHOLE if arguments.shard is None else Shard.parse(arguments.shard)
    # A Ray cluster has its own number of cores.
    workers = arguments.workers or (available_cores() if arguments.engine == "local" else 0)
    report = build_dataset(
        arguments.out,
        open_plan_mix(arguments.plans or ("bundled",), arguments.ids, arguments.layers),
        config,
        make_explorer,
        pairs=arguments.pairs,
        execution=Execution(workers, arguments.engine, arguments.address, arguments.task_timeout),
        shard=shard,
    )
    _report(report)
    if arguments.images is not None:
        render_and_report(arguments.out, arguments.images, ImageConfig(), None, max(workers, 1))


def dataset_config(arguments: GenerateArguments) -> DatasetConfig:
    """The settings that decide the content."""
    from slamgym.dataset.generate.recipe import DatasetConfig, open_recipe

    options = {
        "seed": arguments.seed,
        "plans_filter": arguments.plans_filter,
        "trajectories": arguments.trajectories,
        "explorer": arguments.explorer,
        "minutes": arguments.minutes,
        "recipe": arguments.recipe and open_recipe(arguments.recipe),
    }
    return arguments.settings.configured(DatasetConfig(), options)


def _report(report: BuildReport) -> None:
    """Say what is there now, what was left out, and where to look."""
    from slamgym.commands.dataset.describe import ShowArguments, draw_pairs
    from slamgym.dataset.format import Layout
    from slamgym.dataset.statistics import describe_pairs

    layout = Layout(report.root)
    if report.fresh:
        say(f"{counted(report.fresh, 'new pair')} in {duration(report.seconds)}.")
    else:
        say(f"Nothing to do: {report.root} holds {counted(report.pairs, 'pair')} already.")
    if report.rejected:
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(report.rejected.items()))
        skipped = counted(sum(report.rejected.values()), "plan")
        say(f"Skipped {skipped} ({kinds}); {layout.rejected} says why.")
    tell(*describe_pairs(report.root).splitlines())
    if report.pairs > 0:
        _, path = draw_pairs(ShowArguments(report.root))
        tell(f"contact sheet: {path}")
