"""Read folders of map pairs for training.

Two layouts are taken:

* ``IMAGES/{train,test}/{A,B}/<name>.png``, as `slamgym dataset render` writes them, next to a ``manifest.jsonl``
  with plans and scales;
* ``IMAGES/{A,B}/<name>.png``: any folder of pairs, without splits.

A is the CAD map (0 walls and outside, 254 inside), B the SLAM map (0 occupied, 205 unknown, 254 free); white may be
255, and PNG is one format of several (:mod:`slamgym.gan.pair_files`). All images are square, grey, and of one size;
file names are the same on both sides but for the format. Without a manifest every name is a separate plan.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from slamgym.core.documents import parse_json, read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import sha256_of, text_lines
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.types import UNKNOWN, ByteArray, FloatArray, IntArray
from slamgym.gan.encoding import resample_grey
from slamgym.gan.pair_files import cad_shares, pictures_in, read_grey, slam_cells
from slamgym.metrics.layers import USUAL_SCALE
from slamgym.metrics.maps import resample_slam


@dataclass(frozen=True)
class PairSet:
    """Map pairs in memory."""

    cad: ByteArray  # (N, S, S)
    slam: ByteArray  # (N, S, S)
    names: tuple[str, ...]
    plan_ids: tuple[str, ...]
    """Pairs of one plan must not be separated by a split."""
    metres_per_px: FloatArray  # (N,) of these images; nan where the manifest has none

    def __len__(self) -> int:
        return len(self.names)

    def scale(self, index: int) -> float:
        """Metres per pixel of one pair; nan if they aren't known."""
        return float(self.metres_per_px[index])

    def usual_scale(self, index: int) -> float:
        """Metres per pixel of one pair; that of most rendered homes if they aren't known."""
        known = self.scale(index)
        return known if math.isfinite(known) else USUAL_SCALE

    def subset(self, indices: Sequence[int] | IntArray) -> "PairSet":
        """The pairs with these indices."""
        chosen = np.asarray(indices, dtype=np.int64)
        return PairSet(
            self.cad[chosen],
            self.slam[chosen],
            tuple(self.names[i] for i in chosen),
            tuple(self.plan_ids[i] for i in chosen),
            self.metres_per_px[chosen],
        )

    def windows(self, side: int) -> "PairSet":
        """The pairs cut to windows of this side [px] about the middle of what their SLAM maps show."""
        if len(self) == 0 or self.cad.shape[1] <= side:
            return self
        cads = []
        slams = []
        for cad, slam in zip(self.cad, self.slam, strict=True):
            known = np.argwhere(slam != UNKNOWN)
            middle = known.mean(axis=0).astype(int) if len(known) else (0, 0)
            row, col = window_corner(slam, side, middle)
            window = slice(row, row + side), slice(col, col + side)
            cads.append(cad[window])
            slams.append(slam[window])
        return replace(self, cad=np.stack(cads), slam=np.stack(slams))

    def split(self, share: float) -> tuple["PairSet", "PairSet"]:
        """Hold out the pairs of about this share of the plans; which ones follows from the plans' ids alone.

        Returns:
            (the rest, the held-out ones).
        """
        places = np.array([_place(plan) for plan in self.plan_ids], dtype=np.float64)
        rest = np.flatnonzero(places >= share)
        held_out = np.flatnonzero(places < share)
        return self.subset(rest), self.subset(held_out)

    def scale_percentiles(self) -> tuple[float, float, float] | None:
        """5th, 50th and 95th percentile of the metres per pixel; None if they aren't known."""
        known = self.metres_per_px[np.isfinite(self.metres_per_px)]
        if known.size == 0:
            return None
        low, middle, high = np.percentile(known, [5.0, 50.0, 95.0]).tolist()
        return low, middle, high


def window_corner(image: ByteArray, side: int, centre: ArrayLike) -> tuple[int, int]:
    """First row and column of a window of this side about a place, moved as far as it takes to lie in the image."""
    wanted = np.subtract(centre, side // 2)
    last = np.subtract(image.shape, side)
    row, col = np.clip(wanted, 0, last).tolist()
    return row, col


def load_pairs(root: Path | str, split: str, size: int) -> PairSet:
    """Read all pairs of a split.

    Args:
        root: The folder of images.
        split: ``train`` or ``test``; a folder without splits has ``train`` only.
        size: Side that the images shall have [px]; they are resampled if theirs is another.

    Raises:
        InputFileError: If the folder or a file is missing, empty or malformed, or a pair is unequal.
    """
    root = Path(root)
    folder = _split_folder(root, split)
    files = _matched(folder)
    names = sorted(files)
    recorded = _manifest(root)
    cad, slam = np.empty((2, len(names), size, size), dtype=np.uint8)
    side = None
    for index, name in enumerate(names):
        a, b = (read_grey(path) for path in files[name])
        side = _check_shapes(files[name], a, b, side)
        cad_path, slam_path = files[name]
        cad[index] = resample_grey(cad_shares(cad_path, a), (size, size))
        slam[index] = resample_slam(slam_cells(slam_path, b), (size, size))
    known = [recorded.get(name, _Recorded(name, name, math.nan)) for name in names]
    read_side = side or size
    scales = np.array([record.metres_per_px * read_side / size for record in known])
    plans = tuple(record.group for record in known)
    return PairSet(cad, slam, tuple(names), plans, scales)


def load_training_pairs(roots: Sequence[Path | str], size: int) -> PairSet:
    """Read the training side of one folder or of several together.

    A plan on the test side of one folder trains nothing from another: its pairs are left out there.

    Args:
        roots: Folders of images.
        size: Side that the images shall have [px]; they are resampled if theirs is another.

    Raises:
        InputFileError: As :func:`load_pairs`, or if nothing is left of a folder.
    """
    if len(roots) == 1:
        return load_pairs(roots[0], "train", size)
    folders = [(Path(root), _manifest(Path(root))) for root in roots]
    tested: set[str] = set()
    for root, recorded in folders:
        for name in _test_names(root):
            tested |= _plans_of(name, recorded)
    parts = []
    for root, recorded in folders:
        pairs = load_pairs(root, "train", size)
        kept = []
        for index, name in enumerate(pairs.names):
            if tested.isdisjoint(_plans_of(name, recorded)):
                kept.append(index)
        if not kept:
            raise InputFileError(root, "has only plans that are on the test side of another folder")
        parts.append(pairs.subset(kept))
    return _joined(parts)


def _joined(parts: Sequence[PairSet]) -> PairSet:
    return PairSet(
        np.concatenate([part.cad for part in parts]),
        np.concatenate([part.slam for part in parts]),
        tuple(name for part in parts for name in part.names),
        tuple(plan for part in parts for plan in part.plan_ids),
        np.concatenate([part.metres_per_px for part in parts]),
    )


def face_lines(root: Path | str) -> float:
    """Thickness of the line along every face of the CAD maps of a folder [px], 0 for true faces.

    Raises:
        InputFileError: If its config.json is malformed.
    """
    edge = _settings(root).get("images", {}).get("edge_px")
    return float(edge) if isinstance(edge, (int, float)) else 0.0


def describe_data(roots: Sequence[Path]) -> str:
    """Folders of images by name, edition and digest of the manifest, for model cards.

    Raises:
        ConfigError: If they are of several editions.
        InputFileError: If a config.json is malformed.
    """
    editions = set()
    described = []
    for root in roots:
        manifest = root / "manifest.jsonl"
        facts = []
        dataset = _settings(root).get("dataset")
        if dataset:
            edition = dataset.get("edition")
            editions.add(edition)
            facts.append(f"edition {edition}")
        if manifest.is_file():
            facts.append(f"manifest.jsonl {sha256_of(manifest)[:16]}")
        described.append(f"{root.name} ({', '.join(facts)})" if facts else root.name)
    if len(editions) > 1:
        raise ConfigError(
            f"{', '.join(described)}: maps of several editions look unlike, so no training mixes them; make those of "
            "the older one anew by `slamgym generate` and `slamgym dataset render`"
        )
    return ", ".join(described)


def _settings(root: Path | str) -> dict[str, Any]:
    """What a folder's config.json says of its images and their dataset; empty without one."""
    path = Path(root) / "config.json"
    if not path.is_file():
        return {}
    settings = read_json(path)
    if not isinstance(settings, dict):
        return {}
    return {name: part for name, part in settings.items() if isinstance(part, dict)}


def _split_folder(root: Path, split: str) -> Path:
    if not root.is_dir():
        raise InputFileError(
            root, "is not a folder; name one that `slamgym dataset render` has written"
        )
    if (root / "episodes").is_dir():
        raise InputFileError(
            root, "holds explorations; make images of them by `slamgym dataset render`"
        )
    if (root / split / "A").is_dir() or (root / split / "B").is_dir():
        return root / split
    if split == "train" and ((root / "A").is_dir() or (root / "B").is_dir()):
        return root
    raise InputFileError(
        root, f"holds no pairs: it needs {split}/A and {split}/B with images of equal names"
    )


def _matched(folder: Path) -> dict[str, tuple[Path, Path]]:
    """Files of both sides by name."""
    cads = _images(folder / "A")
    slams = _images(folder / "B")
    lonely = sorted(cads.keys() ^ slams.keys())
    if lonely:
        first = lonely[0]
        side, other = ("A", "B") if first in cads else ("B", "A")
        raise InputFileError(
            folder,
            f"holds images without a counterpart, {len(lonely)} of them; "
            f"the first is {side}/{first} without {other}/{first}",
        )
    return {name: (cads[name], slams[name]) for name in cads}


def _images(folder: Path) -> dict[str, Path]:
    if not folder.is_dir():
        raise InputFileError(
            folder, "is missing; pairs need a folder A (CAD) and a folder B (SLAM)"
        )
    images = pictures_in(folder)
    if not images:
        raise InputFileError(folder, f"holds no images ({', '.join(PICTURE_SUFFIXES)})")
    found = {path.stem: path for path in images}
    for path in images:
        if found[path.stem] is not path:
            raise InputFileError(path, f"has the name of {found[path.stem].name}, too; remove one")
    return found


def _check_shapes(paths: tuple[Path, Path], a: ByteArray, b: ByteArray, side: int | None) -> int:
    if a.shape != b.shape:
        raise InputFileError(paths[1], f"has shape {b.shape} but its counterpart A has {a.shape}")
    if a.shape[0] != a.shape[1]:
        raise InputFileError(paths[0], f"has shape {a.shape}; training images are square")
    if side is not None and a.shape[0] != side:
        raise InputFileError(
            paths[0],
            f"has {a.shape[0]} px a side but the images before it {side}; render all at one size",
        )
    return len(a)


class _Recorded(NamedTuple):
    """Plan and group of a pair, as the manifest records them."""

    plan: str
    group: str
    """Near-duplicates of a plan form a group; a split must not separate them either."""
    metres_per_px: float


def _manifest(root: Path) -> dict[str, _Recorded]:
    """The records by name; empty without a manifest."""
    path = root / "manifest.jsonl"
    if not path.is_file():
        return {}
    recorded: dict[str, _Recorded] = {}
    for line, where in text_lines(path):
        values = parse_json(line, where)
        try:
            plan = str(values["plan_id"])
            scale = float(values["metres_per_px"])
            if not 0.0 < scale < math.inf:
                raise ValueError(f"metres_per_px is {scale}")
            group = str(values.get("group") or plan)
            recorded[str(values["name"])] = _Recorded(plan, group, scale)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
            raise InputFileError(where, f"is not a record of an image pair ({error})") from error
    return recorded


def _test_names(root: Path) -> list[str]:
    """Names of the pairs on the test side; none without images there."""
    folder = root / "test" / "A"
    if not folder.is_dir() or not any(folder.iterdir()):
        return []
    return list(_images(folder))


def _plans_of(name: str, recorded: dict[str, _Recorded]) -> set[str]:
    """Names of a pair's plan and of its group."""
    if name not in recorded:
        return {name}
    record = recorded[name]
    return {record.plan, record.group}


def _place(plan_id: str) -> float:
    """A fixed number in [0, 1) for a plan."""
    digest = hashlib.sha256(plan_id.encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2.0**64
