"""The layers of docs/architecture.md, kept by walking every import statement."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOUNDATION = {"types", "geometry", "errors", "config", "command_table", "jit", "__init__", "warmup"}
# A layer may import the layers before it; everything may import the foundation.
LAYERS = ["interop", "cad", "world", "sensors", "slam", "planning", "envs", "dataset"]
# Of the dataset, the translators see the files on disk and how progress is told.
SEEN_BY_GAN = ("slamgym.dataset.format", "slamgym.dataset.images.format", "slamgym.core.progress")
SIDE_LAYERS = {
    "metrics": set(),
    "parametric": {"interop", "cad", "planning", "sensors", "metrics"},
}


def imported_names(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def layer_of(name: str) -> str | None:
    """The slamgym layer that a dotted name belongs to, None for the foundation and other packages."""
    parts = name.split(".")
    known = {*LAYERS, *SIDE_LAYERS, "cli"}
    return parts[1] if parts[0] == "slamgym" and len(parts) > 1 and parts[1] in known else None


def allowed_layers(layer: str) -> set[str]:
    if layer in SIDE_LAYERS:
        return SIDE_LAYERS[layer] | {layer}
    below = set(LAYERS[: LAYERS.index(layer) + 1])
    # Calibrating the parametric model drives the environment, and a pair may come from either of the two.
    return below | {"metrics"} | ({"parametric"} if layer == "dataset" else set())


@pytest.mark.parametrize(
    "path", sorted((ROOT / "slamgym").rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT))
)
def test_slamgym_module_imports_only_layers_below_it(path: Path) -> None:
    relative = path.relative_to(ROOT / "slamgym")
    layer = relative.parts[0].removesuffix(".py")
    names = set(imported_names(path))
    if layer != "cli":
        unexpected = {name for name in names if name.split(".")[0] in {"agents", "gan"}}
        assert not unexpected, (
            f"only slamgym/commands/cli.py may name agents or gan, not {relative}: {unexpected}"
        )
    if layer == "cli" or layer in FOUNDATION:
        return
    used = {found for name in names if (found := layer_of(name))}
    assert used <= allowed_layers(layer), f"{relative} imports {used - allowed_layers(layer)}"


@pytest.mark.parametrize("path", sorted((ROOT / "gan").rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_gan_sees_only_the_dataset_format_metrics_and_cad(path: Path) -> None:
    for name in imported_names(path):
        if name.startswith("slamgym."):
            seen = layer_of(name)
            assert seen in {None, "metrics", "cad", "interop"} or name.startswith(SEEN_BY_GAN), name
        assert name.split(".")[0] != "agents"


def test_the_base_install_needs_no_torch() -> None:
    for path in (ROOT / "slamgym").rglob("*.py"):
        heads = {name.split(".")[0] for name in imported_names(path)}
        assert not heads & {"torch", "stable_baselines3", "sb3_contrib"}, path
