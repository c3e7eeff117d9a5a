"""Odometry that leads on farther than any laser sees is left out: nothing can be told of such a way."""

import numpy as np
import pytest

from slamgym.commands.cli import main
from slamgym.interop import open_log


@pytest.mark.parametrize("seconds", [0.2, 100.0])
def test_odometry_that_is_far_away_at_each_scan_is_left_out(tmp_path, capsys, seconds):
    rng = np.random.default_rng(1)
    lines = []
    for k in range(25):
        ranges = " ".join(f"{r:.2f}" for r in rng.uniform(2.0, 5.0, 180))
        pose = f"{900.0 * k:.2f} 0.0 0.0"
        lines.append(f"FLASER 180 {ranges} {pose} {pose} {seconds * k:.2f} host {seconds * k:.2f}")
    path = tmp_path / "far.log"
    path.write_text("\n".join(lines) + "\n")
    log = open_log(path)
    assert {finding.kind for finding in log.findings} >= {"jump"}
    assert np.ptp(log.track.poses[:, 0]) == 0.0
    assert main(["slam", str(path), "-o", str(tmp_path / "out")]) == 0
    assert "in 24 places; by 900.0 m" in capsys.readouterr().err.replace("\n", " ")
