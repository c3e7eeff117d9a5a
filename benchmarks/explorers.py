"""Evaluate all explorers and write the tables and the plot of docs/explorers.md.

    python benchmarks/explorers.py json.tar.gz [--count 200] [--offices 20] [--explorers a,b,c]

It runs ``slamgym agents evaluate`` on HouseExpo's test plans and on generated offices, privileged yardstick
included. What was done before, in ``--out``, is not done again, so the same command after an interruption goes
on, and once all is done it only writes the tables anew.
"""

import dataclasses
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import tyro
from report import RESULTS, environment

from agents.coverage_plot import draw_coverage
from agents.evaluate import Evaluation, EvaluationConfig, evaluate
from agents.evaluate_command import open_source
from agents.evaluation_report import write_report
from agents.evaluation_summary import summarise
from agents.registry import EXPLORERS
from slamgym.cad.sources import PlanSource

PAGE = Path(__file__).parents[1] / "docs" / "explorers.md"
PLOT = PAGE.parent / "images" / "coverage_over_time.png"


@dataclass(frozen=True)
class Arguments:
    """Evaluate all explorers."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans: a folder or a .tar.gz."""
    count: int = 200
    """How many of them."""
    offices: int = 20
    """How many generated offices; 0 for none."""
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


def main() -> None:
    arguments = tyro.cli(Arguments)
    config = EvaluationConfig(
        explorers=tuple(arguments.explorers.split(",")),
        count=arguments.count,
        seed=arguments.seed,
        full_knowledge=True,
    )
    houses = run("houseexpo", "HouseExpo", open_source(arguments.plans), config, arguments)
    draw_coverage(houses.trials, PLOT, f"{arguments.count} HouseExpo plans: mean, with its 95 % interval")
    shutil.copy(PLOT, arguments.out / "houseexpo" / PLOT.name)
    if arguments.offices:
        offices = dataclasses.replace(config, count=arguments.offices, split=None, plans_filter="none")
        run("offices", "Generated offices, with loops", open_source("offices"), offices, arguments)


def run(
    name: str, heading: str, source: PlanSource, config: EvaluationConfig, arguments: Arguments
) -> Evaluation:
    """Evaluate on one kind of plans; write its part of the page and its figures."""
    out = arguments.out / name
    evaluation = evaluate(source, config, out, arguments.workers)
    text = write_report(out, evaluation, config, arguments.against)
    print(text)
    replace_part(PAGE, name, f"### {heading}\n\n{text}")
    summary = dataclasses.asdict(summarise(evaluation.trials, arguments.against))
    document = {"name": f"explorers_{name}", **environment(), "seed": config.seed, "summary": summary}
    # The path of the plans is the machine's own.
    document["command"] = f"python benchmarks/explorers.py json.tar.gz --count {arguments.count}"
    path = RESULTS / f"explorers_{name}.json"
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return evaluation


def replace_part(page: Path, name: str, text: str) -> None:
    """Put a text between the marks ``<!-- name -->`` and ``<!-- end of name -->`` of a page."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, found, rest = page.read_text(encoding="utf-8").partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise SystemExit(f"{page} lacks the marks {begin} and {end}")
    page.write_text(f"{before}{begin}\n\n{text}\n{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
