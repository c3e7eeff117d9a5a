"""The commands and files of docs/scale.md: what a reader copies is accepted."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import tyro
import yaml

from slamgym.commands.dataset.folders import MergeArguments
from slamgym.commands.generate import GenerateArguments
from slamgym.dataset.format import Shard

TEXT = (Path(__file__).parents[2] / "docs" / "scale.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)
SCRIPTS = [block for language, block in BLOCKS if language == "bash"]
COMMANDS = re.findall(r"slamgym (generate|dataset merge) ([^'\n]+)", "\n".join(SCRIPTS))


@pytest.mark.parametrize(("name", "options"), COMMANDS)
def test_the_commands_take_their_options(name, options):
    options = options.replace("$SLURM_ARRAY_TASK_ID", "7").replace("$SCRATCH", "/scratch")
    arguments = tyro.cli(
        GenerateArguments if name == "generate" else MergeArguments, args=shlex.split(options)
    )
    if isinstance(arguments, GenerateArguments) and arguments.shard is not None:
        assert Shard.parse(arguments.shard) == Shard(7, 100)


def test_the_document_shows_each_way():
    options = " ".join(options for _, options in COMMANDS)
    assert "--engine ray --address auto" in options
    assert "--shard" in options
    assert ("dataset merge", '"$SCRATCH/pairs"') in COMMANDS


@pytest.mark.skipif(shutil.which("bash") is None, reason="checks bash scripts")
@pytest.mark.parametrize("script", SCRIPTS)
def test_the_scripts_are_well_formed(script):
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)


def test_the_cluster_file_is_what_ray_reads():
    (cluster,) = (yaml.safe_load(block) for language, block in BLOCKS if language == "yaml")
    assert cluster["provider"]["type"] == "local"
    assert len(cluster["provider"]["worker_ips"]) == cluster["max_workers"]
    assert all(
        isinstance(line, str)
        for key in ("setup_commands", "head_start_ray_commands", "worker_start_ray_commands")
        for line in cluster[key]
    )
