"""A seed below 0 is refused in a sentence, by each command that takes one."""

import pytest

from slamgym.commands.cli import main


@pytest.mark.parametrize(
    "line",
    [
        ["generate", "--plans", "bundled", "--pairs", "1", "-o", "OUT"],
        ["watch", "--out", "OUT.gif"],
        ["agents", "evaluate", "--explorers", "nearest", "--count", "1", "-o", "OUT"],
        ["dataset", "split", "OUT"],
    ],
    ids=lambda line: " ".join(line[:2]),
)
@pytest.mark.parametrize("seed", ["-5", str(2**63)])
def test_a_seed_that_is_none_is_refused(line, seed, tmp_path, capsys):
    line = [word.replace("OUT", str(tmp_path / "out")) for word in line]
    assert main([*line, "--seed", seed]) == 2
    error = capsys.readouterr().err
    assert "--seed must be" in error
    assert "Traceback" not in error
    assert len(error.splitlines()) == 1
