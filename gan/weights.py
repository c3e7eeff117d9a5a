"""Trained translators as files: safetensors in half precision, settings and model card in the header.

Beside ``NAME.safetensors`` lie ``NAME.json`` (settings and figures, for programs) and ``NAME.md`` (the model card, for
people); only the first is needed. Nothing in the file can run code, and loading needs no network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from safetensors import SafetensorError, safe_open

from slamgym import __version__
from slamgym.core.config import from_dict, suggest, to_dict
from slamgym.core.documents import json_text, load_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import open_regular, require_file, write_bytes, write_text
from slamgym.core.limits import WEIGHT_BYTES
from slamgym.core.progress import duration
from slamgym.core.provenance import check_origin
from slamgym.core.text import markdown
from slamgym.gan.config import Direction, TranslatorConfig

if TYPE_CHECKING:
    from torch import Tensor

    from slamgym.gan.networks.factory import Generator

_ARROWS = {"slam2cad": "SLAM maps to CAD maps", "cad2slam": "CAD maps to SLAM maps"}
"""Directions in words."""
WEIGHTS_FORMAT = "slamgym-translator-3"
PRETRAINED_FOLDER = Path(__file__).parent / "pretrained"
MAX_PARAMETERS = 200_000_000
"""Settings in a file of unknown origin may ask for any size; beyond this they are refused before memory is taken."""


@dataclass(frozen=True)
class ModelCard:
    """Where weights come from and how good they were on held-out pairs."""

    preset: str = ""
    pairs: int = 0
    """Training pairs."""
    images: int = 0
    """Pairs drawn in the training, repetitions included."""
    seconds: float = 0.0
    """Wall-clock time of the training."""
    seed: int = 0
    command: str = ""
    data: str = ""
    """Source of the pairs."""
    device: str = ""
    figures: dict[str, float] = field(default_factory=dict)
    """On held-out pairs at the end of the training."""
    version: str = __version__


@dataclass(frozen=True)
class Weights:
    """A generator ready to use."""

    generator: Generator
    config: TranslatorConfig
    card: ModelCard


def save_translator(
    path: Path, generator: Generator, config: TranslatorConfig, card: ModelCard
) -> None:
    """Write weights, settings and card.

    Args:
        path: ``NAME.safetensors``.
        generator: Its batch norms' statistics stay in single precision: their range may exceed half's.
        config: What it is.
        card: Where it comes from.

    Raises:
        InputFileError: If it can't be written.
    """
    from safetensors.torch import save

    tensors = {name: _halved(name, value) for name, value in generator.state_dict().items()}
    facts = {"config": to_dict(config), "card": to_dict(card)}
    header = {
        "format": WEIGHTS_FORMAT,
        "config": json.dumps(facts["config"]),
        "card": json.dumps(facts["card"]),
    }
    # As bytes: safetensors' own file would be readable by its writer alone.
    write_bytes(path, save(tensors, metadata=header))
    write_text(path.with_suffix(".json"), json_text(facts))
    write_text(path.with_suffix(".md"), model_card(path.stem, generator, config, card))


def load_weights(name_or_path: str | Path, direction: Direction | None = None) -> Weights:
    """Read weights: the name of pretrained ones, or a file.

    Args:
        name_or_path: E.g. ``slam2cad``, or the path of a ``.safetensors`` file or of a run's folder.
        direction: What they must translate; None takes any.

    Raises:
        InputFileError: If the file is missing, damaged, unsafe, or no translator.
        ConfigError: If no pretrained weights have this name, or they translate the other way.
    """
    path = find_weights(name_or_path)
    config, card, tensors = load_tensors(path, direction, "pt")
    return Weights(_fill(path, config, tensors), config, card)


def load_tensors(
    path: Path, direction: Direction | None = None, framework: Literal["np", "pt"] = "np"
) -> tuple[TranslatorConfig, ModelCard, dict[str, Any]]:
    """Read a file of weights: its settings, its card, and arrays of NumPy, or tensors of torch.

    Raises:
        InputFileError: If the file is missing, damaged, unsafe, or no translator.
        ConfigError: If they translate the other way.
    """
    check_origin(path)
    header, tensors = read_tensors(path, framework)
    config, card = _read_header(path, header)
    if direction is not None and direction != config.direction:
        raise ConfigError(
            f"{path}: these weights translate {_ARROWS[config.direction]}, not {_ARROWS[direction]}; "
            "choose others with --weights"
        )
    return config, card, tensors


def read_tensors(
    path: Path, framework: Literal["np", "pt"] = "pt"
) -> tuple[dict[str, str], dict[str, Any]]:
    """Header and tensors of a safetensors file, as arrays of NumPy or tensors of torch.

    Raises:
        InputFileError: If it is missing, too large, damaged or of another kind.
    """
    require_file(path, WEIGHT_BYTES)
    try:
        with safe_open(path, framework=framework) as file:
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 - not a mapping
            return file.metadata() or {}, tensors
    except (SafetensorError, OSError) as error:
        raise InputFileError(path, _why_unreadable(path, error)) from error


def pretrained_names() -> list[str]:
    """Names of the weights that come with the package."""
    return sorted(path.stem for path in PRETRAINED_FOLDER.glob("*.safetensors"))


def find_weights(name_or_path: str | Path) -> Path:
    """The file of pretrained weights, of a path, or of a run's folder.

    Raises:
        ConfigError: If it is a plain name and no pretrained weights have it.
        InputFileError: If the path doesn't exist.
    """
    path = Path(name_or_path)
    if path.is_dir() and (path / "weights.safetensors").is_file():
        return path / "weights.safetensors"
    if path.is_file():
        return path
    if path.name == str(name_or_path) and not path.suffix:
        file = PRETRAINED_FOLDER / f"{path.name}.safetensors"
        if file.is_file():
            return file
        known = pretrained_names()
        if not known:
            raise ConfigError(
                f"no weights are called {path.name!r}; there are none; train some with `slamgym gan train`"
            )
        raise ConfigError(f"no weights are called {path.name!r}; {suggest(path.name, known)}")
    raise InputFileError(
        path, "doesn't exist; name pretrained weights, a .safetensors file or a finished run"
    )


def model_card(name: str, generator: Generator, config: TranslatorConfig, card: ModelCard) -> str:
    """The model card in Markdown."""
    from slamgym.gan.networks.factory import count_parameters

    figures = [(key, f"{value:.4g}") for key, value in card.figures.items()]
    low, middle, high = config.metres_per_px
    return (
        f"# {name}\n\n"
        f"Translates {_ARROWS[config.direction]}; preset `{card.preset}` of slamgym {card.version}, "
        f"{count_parameters(generator):,} weights. Licence: MIT.\n\n"
        f"- Input: {config.input_size} x {config.input_size} px, {low:.3f} to {high:.3f} m/px (median {middle:.3f}), "
        f"encoded as `{config.input_encoding}`; output {config.output_size} x {config.output_size} px as "
        f"`{config.output_encoding}`.\n"
        f"- Data: {card.data or 'simulated explorations'}, {card.pairs:,} training pairs, "
        f"{card.images:,} images drawn.\n"
        f"- Training: {duration(card.seconds)} on {card.device or 'an unknown device'}, seed {card.seed}.\n"
        f"- Command: `{card.command or 'not recorded'}`\n\n"
        "## Figures on held-out pairs at the end of the training\n\n"
        "Not aligned; `slamgym gan evaluate` gives those of the paper's protocol.\n\n"
        f"{markdown(('figure', 'value'), figures)}\n"
        "## Limits\n\n"
        "Trained on simulated explorations of homes and offices by a robot with a 2D scanner. "
        f"{_limits(config)}\n"
    )


def _limits(config: TranslatorConfig) -> str:
    if config.direction == "cad2slam":
        return "One CAD map gives one SLAM map: there is no noise input (bend the CAD map to get another)."
    unseen = "Rooms that the robot never saw are guessed or missing"
    if config.output_encoding == "layers":
        unseen = "Floor ends half a metre beyond what the robot saw"
    return f"{unseen}; buildings with curved walls or with directions that aren't at right angles are squared off."


def _halved(name: str, value: Tensor) -> Tensor:
    plain = value.detach().cpu()
    if "running_" in name or not value.is_floating_point():
        return plain.contiguous().clone()
    return plain.half().contiguous()


def _read_header(path: Path, header: dict[str, str]) -> tuple[TranslatorConfig, ModelCard]:
    found = header.get("format", "")
    if found != WEIGHTS_FORMAT:
        if found.startswith(WEIGHTS_FORMAT.rstrip("0123456789")):
            raise InputFileError(
                path,
                f"holds weights of another version of slamgym ({found}); train them again with this one",
            )
        raise InputFileError(path, "is a safetensors file, but not of a slamgym translator")
    try:
        config = from_dict(TranslatorConfig, load_json(header["config"]), str(path))
        card = from_dict(ModelCard, load_json(header["card"]), str(path))
    except (KeyError, ValueError, ConfigError) as error:
        raise InputFileError(path, f"has settings that can't be used ({error})") from error
    return config, card


def _fill(path: Path, config: TranslatorConfig, tensors: dict[str, Tensor]) -> Generator:
    import torch

    from slamgym.gan.networks.factory import build_generator, count_parameters

    # Shapes are compared before any memory is taken.
    with torch.device("meta"):
        generator = build_generator(config, seed=None)
    if count_parameters(generator) > MAX_PARAMETERS:
        raise InputFileError(path, "asks for a network of unreasonable size")
    wanted = _shapes(generator.state_dict())
    found = _shapes(tensors)
    odd = [name for name in wanted | found if wanted.get(name) != found.get(name)]
    if odd:
        raise InputFileError(
            path, f"holds tensors of another network ({len(odd)} differ, the first is {min(odd)})"
        )
    whole = {}
    for name, value in tensors.items():
        whole[name] = value.float() if value.is_floating_point() else value
        if not bool(torch.isfinite(whole[name]).all()):
            raise InputFileError(path, "holds weights that are NaN or infinite")
    generator.load_state_dict(whole, assign=True)
    return generator.eval().requires_grad_(False)


def _shapes(tensors: Mapping[str, Tensor]) -> dict[str, tuple[bool, tuple[int, ...]]]:
    """For each tensor: true if it holds floating-point numbers, and its shape."""
    return {
        name: (value.is_floating_point(), tuple(value.shape)) for name, value in tensors.items()
    }


def _why_unreadable(path: Path, error: Exception) -> str:
    with open_regular(path) as file:
        start = file.read(4)
    if start[:2] == b"PK" or start[:1] == b"\x80":
        return (
            "is a pickle or a torch.save file, which can run code when it is read; "
            "only safetensors are taken"
        )
    return f"is damaged or not a safetensors file ({error})"
