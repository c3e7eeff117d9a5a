"""Golden tests: what the programs made when the expected values were stored, they must make again.

``golden.json`` holds, case by case, digests and a few figures that a person can read: when a digest differs, the
figures say how far off the result is. What the networks draw is kept as PNG files, of which a few pixels may
differ. ``python -m pytest tests/golden`` compares;

    python -m pytest tests/golden --renew-golden

stores what is measured now and lists the cases that changed, which is right only where a change was meant. Cases
that were not run keep their values; delete the lines of a case that is gone by hand.

A name that is written to files and has been changed on purpose goes into ``renamed.json`` as ``"old": "new"``:
stored names are translated by it before they are compared, so the figures needn't be renewed. It applies to the
parts of a case's name, and to keys and texts anywhere in a case.
"""

import hashlib
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED

STORE = Path(__file__).with_name("golden.json")
RENAMED = Path(__file__).with_name("renamed.json")
DECIMALS = 4  # a tenth of a millimetre: libm and compilers differ in the last bit from processor to processor
FIGURES = 6  # decimals of figures that are stored as numbers ...
TOLERANCE = 1e-5  # ... and by how much they may differ, so that no rounding decides


def recorded(name, renamed):
    """The name of today of what was stored under ``name``: as a whole, or part by part between dots."""
    return renamed.get(name, ".".join(renamed.get(part, part) for part in name.split(".")))


def with_names_of_today(value, renamed):
    """A stored value with all its keys and texts renamed."""
    if isinstance(value, dict):
        return {
            recorded(key, renamed): with_names_of_today(item, renamed)
            for key, item in value.items()
        }
    if isinstance(value, list):
        return [with_names_of_today(item, renamed) for item in value]
    return recorded(value, renamed) if isinstance(value, str) else value


def differences(expected, measured, where=""):
    """Every place where two JSON values differ, as lines of text."""
    if isinstance(expected, dict) and isinstance(measured, dict):
        lines = []
        for key in sorted({*expected, *measured}):
            place = f"{where}.{key}".lstrip(".")
            if key not in measured or key not in expected:
                lines.append(f"{place}: only {'stored' if key in expected else 'measured'}")
            else:
                lines += differences(expected[key], measured[key], place)
        return lines
    if isinstance(expected, list) and isinstance(measured, list) and len(expected) == len(measured):
        pairs = enumerate(zip(expected, measured, strict=True))
        return [line for i, (a, b) in pairs for line in differences(a, b, f"{where}[{i}]")]
    numbers = all(isinstance(value, int | float) for value in (expected, measured))
    same = abs(expected - measured) <= TOLERANCE if numbers else expected == measured
    return [] if same else [f"{where}: stored {expected!r}, measured {measured!r}"]


class Golden:
    """The store of expected values, and the digests that go into it."""

    def __init__(self, is_renewing):
        renamed = json.loads(RENAMED.read_text())
        stored = json.loads(STORE.read_text()) if STORE.is_file() else {}
        self.expected = {
            "/".join(recorded(part, renamed) for part in case.split("/")): with_names_of_today(
                values, renamed
            )
            for case, values in stored.items()
        }
        self.is_renewing = is_renewing
        self.measured = {}
        self.pictures = {}

    def check(self, case, measured):
        """Compare a case, or keep it to be stored."""
        measured = json.loads(json.dumps(measured))
        self.measured[case] = measured
        if self.is_renewing:
            return
        assert case in self.expected, f"no value is stored for {case!r}; run with --renew-golden"
        found = differences(self.expected[case], measured)
        assert not found, f"{case} is not what it was:\n  " + "\n  ".join(found)

    def check_picture(self, name, cells, most_different):
        """Compare a small map with the PNG file of that name: the share of pixels that may differ."""
        path = STORE.with_name(f"{name}.png")
        stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
        share = (
            1.0
            if stored is None or stored.shape != cells.shape
            else float((stored != cells).mean())
        )
        if self.is_renewing:
            self.pictures[path] = (cells, share)
            return
        assert stored is not None, f"there is no {path.name}; run with --renew-golden"
        assert share <= most_different, f"{share:.2%} of the pixels differ from {path.name}"

    def store(self):
        """Write what was measured; returns a line for each case that is new or changed."""
        lines = []
        for path, (cells, share) in self.pictures.items():
            if share > 0.0:
                lines.append(f"changed  {path.name}: {share:.2%} of the pixels")
                cv2.imwrite(str(path), cells)
        for case, values in sorted(self.measured.items()):
            if case not in self.expected:
                lines.append(f"new      {case}")
            elif found := differences(self.expected[case], values):
                lines.append(f"changed  {case}: {'; '.join(found[:3])}")
        lines += [
            f"not run  {case}" for case in sorted(self.expected.keys() - self.measured.keys())
        ]
        content = dict(sorted({**self.expected, **self.measured}.items()))
        text = json.dumps(content, indent=1)
        STORE.write_text(
            re.sub(r"\[[^][{}]*\]", lambda found: " ".join(found[0].split()), text) + "\n"
        )
        RENAMED.write_text("{}\n")  # the names that were stored just now are those of today
        return lines

    @staticmethod
    def digest(content):
        """The first 16 hex digits of the SHA-256 of bytes, or of an array's bytes, type and shape."""
        if isinstance(content, np.ndarray):
            head = f"{content.dtype.str} {content.shape} ".encode()
            content = head + np.ascontiguousarray(content).tobytes()
        return hashlib.sha256(content).hexdigest()[:16]

    @staticmethod
    def rounded_digest(values):
        """Digest of floats, rounded."""
        # Adding 0 makes -0 the 0 that it may as well have been.
        return Golden.digest(np.round(np.asarray(values, np.float64), DECIMALS) + 0.0)

    @staticmethod
    def of_cells(cells):
        """Digest, shape, and the shares of free and occupied cells."""
        shares = {
            name: float((cells == value).mean())
            for name, value in (("free", FREE), ("occupied", OCCUPIED))
        }
        return {
            "shape": list(cells.shape),
            **{name: round(share, 6) for name, share in shares.items()},
            "digest": Golden.digest(cells),
        }

    @staticmethod
    def of_path(poses):
        """Digest of poses (N, 3), their number, the length of the path, and the last."""
        poses = np.asarray(poses, np.float64)
        return {
            "poses": len(poses),
            "length": round(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()), FIGURES),
            "last": [round(float(value), FIGURES) + 0.0 for value in poses[-1]],
            "digest": Golden.rounded_digest(poses),
        }


STASH = pytest.StashKey[Golden]()


@pytest.fixture(scope="session")
def golden(pytestconfig):
    """The store; with --renew-golden it takes everything and is written at the end."""
    is_renewing = pytestconfig.getoption("--renew-golden")
    if is_renewing and hasattr(pytestconfig, "workerinput"):
        pytest.fail("--renew-golden writes one file; run it without -n")
    return pytestconfig.stash.setdefault(STASH, Golden(is_renewing))


def pytest_terminal_summary(terminalreporter, config):
    store = config.stash.get(STASH, None)
    if store is not None and store.is_renewing:
        terminalreporter.section("golden values")
        for line in store.store() or ["all as they were"]:
            terminalreporter.write_line(line)
