"""Evaluate all explorers and write the table and the plot of docs/explorers.md.

    python benchmarks/exploring/explorers.py json.tar.gz [--count 200] [--offices 20] [--workers 2] [--explorers a,b,c]

It runs ``slamgym agents evaluate`` on HouseExpo's test plans and on generated offices of the test split,
the oracle included. What was done before, in ``--out``, is not done again, so the same command after
Ctrl-C or a kill continues, and once all is done it only writes the tables again. ``--no-page`` doesn't change page,
plot and results of the repository.
"""

import dataclasses
import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgym.agents.evaluation.evaluate import Evaluation, EvaluationConfig, evaluate
from slamgym.agents.evaluation.report import draw_coverage, write_report
from slamgym.agents.evaluation.summary import summarise_trials
from slamgym.agents.registry import EXPLORERS
from slamgym.cad import open_plans
from slamgym.cad.generator import PlanGeneratorConfig
from slamgym.cad.plan_index import PlanSource
from slamgym.cad.sources import generated_plans
from slamgym.core.errors import SlamgymError
from slamgym.core.parallel.engine import Execution

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import RESULTS, environment

MODULES = ("agents", "slamgym/planning", "slamgym/slam")
"""What is measured."""

PAGE = Path(__file__).parents[2] / "docs" / "explorers.md"
PLOT = PAGE.parent / "images" / "coverage_over_time.png"
ON_PAGE = "houseexpo"
"""The page shows the table of these plans; benchmarks/results holds all figures."""
SECOND_TABLE = "Time to a share of the floor"
"""The page shows what comes before this."""


@dataclass(frozen=True)
class Arguments:
    """Evaluate all explorers."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans: a folder or a .tar.gz."""
    count: int = 200
    """Number of them; 0 for none."""
    offices: int = 20
    """Number of generated offices; 0 for none."""
    explorers: str = ",".join(name for name in EXPLORERS if name != "random")
    """Names, with commas between them. The random walk takes as long as all others together."""
    against: str = "explore_lite"
    """The reference."""
    seed: int = 0
    """Decides plans, starts and noise."""
    workers: int = 1
    """Processes."""
    out: Path = Path("out/explorers")
    """Folder of the trials."""
    page: bool = True
    """Write docs/explorers.md, its plot and benchmarks/results; --no-page for a trial run."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    try:
        evaluate_all(arguments)
    except SlamgymError as error:
        raise SystemExit(f"explorers.py: error: {error}") from None
    except KeyboardInterrupt:
        raise SystemExit(f"interrupted; the same command goes on from {arguments.out}") from None


def evaluate_all(arguments: Arguments) -> None:
    config = EvaluationConfig(
        explorers=tuple(name.strip() for name in arguments.explorers.split(",") if name.strip()),
        seed=arguments.seed,
        oracle=True,
    )
    if arguments.count:
        homes = dataclasses.replace(config, count=arguments.count)
        houses = run("houseexpo", "HouseExpo", open_plans(arguments.plans), homes, arguments)
        plot = arguments.out / "houseexpo" / PLOT.name
        number = len({trial.plan for trial in houses.trials})
        draw_coverage(
            houses.trials, plot, f"{number} HouseExpo plans: mean, with its 95 % interval"
        )
        if arguments.page:
            shutil.copy(plot, PLOT)
    if arguments.offices:
        # Learning drew from seed 0 of the generator; the split by id holds for generated plans too.
        offices = dataclasses.replace(config, count=arguments.offices, plans_filter="none")
        source = generated_plans(1, PlanGeneratorConfig(kind="office"), name="office")
        run("offices", "Generated offices, with loops", source, offices, arguments)


def run(
    name: str, heading: str, source: PlanSource, config: EvaluationConfig, arguments: Arguments
) -> Evaluation:
    """Evaluate on one kind of plans; write its figures, and for the homes the table of the page."""
    out = arguments.out / name
    evaluation = evaluate(source, config, out, Execution(workers=arguments.workers))
    text = write_report(out, evaluation, config, arguments.against)
    print(f"### {heading}\n\n{text}")
    if not arguments.page:
        return evaluation
    if name == ON_PAGE:
        replace_part(PAGE, name, f"### {heading}\n\n{text.partition(SECOND_TABLE)[0].rstrip()}\n")
    summary = dataclasses.asdict(summarise_trials(evaluation.trials, arguments.against))
    document = {
        "name": f"explorers_{name}",
        **environment(MODULES),
        "seed": config.seed,
        "summary": summary,
    }
    # The path of the plans is the machine's own.
    document["command"] = (
        f"python benchmarks/exploring/explorers.py json.tar.gz --count {arguments.count} --offices {arguments.offices} "
        f"--seed {arguments.seed} "
        f"--explorers {','.join(config.explorers)}"
    )
    path = RESULTS / "exploring" / f"explorers_{name}.json"
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return evaluation


def replace_part(page: Path, name: str, text: str) -> None:
    """Put a text between the marks ``<!-- name -->`` and ``<!-- end of name -->`` of a page."""
    begin = f"<!-- {name} -->"
    end = f"<!-- end of {name} -->"
    before, found, rest = page.read_text(encoding="utf-8").partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise SystemExit(f"{page} lacks the marks {begin} and {end}")
    page.write_text(f"{before}{begin}\n\n{text}\n{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
