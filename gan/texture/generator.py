"""Drawing maps with a trained texture network, and its weights on disk."""

import json
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch.nn import functional

from slamgym.core.config import from_dict, to_dict
from slamgym.core.documents import load_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import require_file, write_bytes
from slamgym.core.grids import paste
from slamgym.core.limits import WEIGHT_BYTES
from slamgym.core.provenance import check_origin
from slamgym.core.types import UNKNOWN, ByteArray, Float32Array
from slamgym.gan.texture.network import CLASSES, FOLD, PASSES, TextureConfig, TextureNetwork, pass_numbers
from slamgym.gan.weights import find_weights

FORMAT = "slamgym-texture-1"
DRAWN_TILE = 512
"""Side of the tiles that larger maps are drawn in [cells]."""
_HALO = 64  # cells round a tile that the network sees, at least its reach


class TextureGenerator:
    """A trained network, ready to draw.

    Args:
        network: The network.
    """

    def __init__(self, network: TextureNetwork) -> None:
        self._network = network.eval().requires_grad_(False).to(torch.bfloat16)

    def draw(self, counted: Float32Array, style: Float32Array, rng: np.random.Generator) -> ByteArray:
        """Draw a map.

        Args:
            counted: (3, H, W) from ``parametric.robot_scans.texture_channels``.
            style: From ``parametric.robot_scans.style_of``.
            rng: The dice: another state, another map.

        Returns:
            (H, W) 0 occupied, 205 unknown, 254 free.
        """
        height, width = counted.shape[1:]
        seen = counted[0] > 0.0
        if not seen.any():
            return np.full((height, width), UNKNOWN, np.uint8)
        rows, cols = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
        # The network sees a margin of what nobody saw, as in the training.
        top, left = (int(n[0]) - 4 for n in (rows, cols))
        down, along = (int(np.ceil((n[-1] + 5 - s) / FOLD)) * FOLD for n, s in ((rows, top), (cols, left)))
        shift = (int(rng.integers(4)), int(rng.integers(4)))
        passes = pass_numbers(down, along, shift)
        # One field of dice for the whole map, so that tiles agree.
        dice = rng.gumbel(size=(len(CLASSES), down, along)).astype(np.float32)
        canvas = np.zeros((3, down + 2 * _HALO, along + 2 * _HALO), np.float32)
        paste(canvas, counted, top - _HALO, left - _HALO)
        classes = self._drawn(canvas, torch.from_numpy(style), passes, dice)
        drawn = np.array(CLASSES, dtype=np.uint8)[classes]
        out = np.full((height, width), UNKNOWN, np.uint8)
        paste(out, drawn, -top, -left)
        return out

    @torch.inference_mode()
    def _drawn(
        self, canvas: Float32Array, style: torch.Tensor, passes: np.ndarray, dice: Float32Array
    ) -> np.ndarray:
        """Classes (H, W) of a canvas with a halo, pass by pass over all tiles."""
        height, width = passes.shape
        known = torch.full((1, height + 2 * _HALO, width + 2 * _HALO), -1, dtype=torch.int64)
        tiles = [
            (r, c, min(r + DRAWN_TILE, height), min(c + DRAWN_TILE, width))
            for r in range(0, height, DRAWN_TILE)
            for c in range(0, width, DRAWN_TILE)
        ]
        trunks = [self._trunk(canvas[:, r : b + 2 * _HALO, c : e + 2 * _HALO], style) for r, c, b, e in tiles]
        for number in range(PASSES):
            fresh = known.clone()
            for (r, c, bottom, end), features in zip(tiles, trunks, strict=True):
                around = known[:, r : bottom + 2 * _HALO, c : end + 2 * _HALO]
                is_known = around >= 0
                drawn = functional.one_hot(around.clamp(min=0), len(CLASSES)).permute(0, 3, 1, 2)
                drawn = (drawn * is_known[:, None]).to(torch.bfloat16)
                logits = self._network.head(features, drawn, is_known[:, None].to(torch.bfloat16))
                logits = logits[0, :, _HALO : _HALO + bottom - r, _HALO : _HALO + end - c].float()
                drawn_now = (logits + torch.from_numpy(dice[:, r:bottom, c:end])).argmax(dim=0)
                now = torch.from_numpy(passes[r:bottom, c:end] == number)
                at = fresh[0, _HALO + r : _HALO + bottom, _HALO + c : _HALO + end]
                at[now] = drawn_now[now]
            known = fresh
        inner: np.ndarray = known[0, _HALO : _HALO + height, _HALO : _HALO + width].numpy()
        return inner

    def _trunk(self, canvas: Float32Array, style: torch.Tensor) -> torch.Tensor:
        counted = torch.from_numpy(np.ascontiguousarray(canvas))[None].to(torch.bfloat16)
        counted = counted.to(memory_format=torch.channels_last)
        return self._network.trunk(counted, style[None].to(torch.bfloat16))


def save_texture(path: Path, network: TextureNetwork, facts: dict[str, object]) -> None:
    """Write weights in half precision, with settings and where they come from.

    Raises:
        InputFileError: If the file can't be written.
    """
    tensors = {name: value.detach().cpu().half().contiguous() for name, value in network.state_dict().items()}
    header = {"format": FORMAT, "config": json.dumps(to_dict(network.config)), "card": json.dumps(facts)}
    write_bytes(path, save(tensors, metadata=header))


def pretrained_texture() -> Path:
    """The weights that come with the package."""
    return Path(__file__).parent / "pretrained" / "texture.safetensors"


def load_texture(path: str | Path | None = None) -> TextureGenerator:
    """Read weights.

    Args:
        path: A file or a run's folder; None takes those that come with the package.

    Raises:
        InputFileError: If the file can't be used, or holds weights of another method.
        ConfigError: If it is a name and nothing is called so.
    """
    path = pretrained_texture() if path is None else find_weights(path)
    check_origin(path)
    require_file(path, WEIGHT_BYTES)
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            tensors = {key: file.get_tensor(key).float() for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InputFileError(path, f"is damaged or not a safetensors file ({error})") from error
    if header.get("format") != FORMAT:
        raise InputFileError(
            path, "holds weights of another method; --method generator takes those of `slamgym gan texture`"
        )
    try:
        network = TextureNetwork(from_dict(TextureConfig, load_json(header["config"]), str(path)))
        network.load_state_dict(tensors)
    except (KeyError, ValueError, ConfigError, RuntimeError) as error:
        raise InputFileError(
            path, "holds settings or tensors that don't fit this version; train it again"
        ) from error
    return TextureGenerator(network)
