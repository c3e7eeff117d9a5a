"""Sizes that show when something grows out of shape: limits for everybody, and the exceptions that stand today.

Each package is measured in **tokens of code**: names, numbers, operators, as Python's ``tokenize`` counts them, without
comments, docstrings and imports. Formatting doesn't change that count, so packing expressions buys nothing and
unpacking them costs next to nothing. A package may grow by :data:`SLACK` above what stands in :data:`TOKENS`: a new
reward term, explorer or plan format fits in. Where more is needed for something that users need, raise the entry in a
commit of its own that says why. ``python tests/test_ratchets.py`` prints what all packages take now.

An exception to another limit that has shrunk must be lowered here, and one that is within the limit deleted.
"""

import ast
import collections
import io
import math
import re
import sys
import tokenize
from collections.abc import Iterator

from source_tree import NO_ROOM, ROOT, modules, room_of, tree_of

MAX_LINES = 400
MAX_PARAMETERS = 8
MAX_ATTRIBUTES = 15
MAX_WORDS = 36_900
"""Words of the documentation in all: README, CONTRIBUTING and docs/, without comments and tables of results; the
changelog is not counted."""
COMMENTS = re.compile(
    r"<!-- table.*?<!-- end -->|<!--.*?-->|\(measured before \w+\)|\*Measured before [^*]*\*",
    re.DOTALL,
)
"""Also what ``benchmarks/figures.py`` fills in, and adds by git's history."""
SLACK = 0.05
"""So much more than it had a package may have."""

TOKENS: dict[str, int] = {
    "agents": 34850,
    "cad": 26490,
    "commands": 29680,
    "core": 19333,
    "dataset": 29248,
    "drawing": 45326,
    "envs": 40793,
    "gan": 28346,
    "interop": 18879,
    "metrics": 15192,
    "parametric": 13765,
    "planning": 27650,
    "ros2": 24140,
    "sim": 26864,
    "slam": 57745,
    "slamgym": 121,
    "viz": 10638,
}
"""Tokens of code of each package."""
SETTINGS: dict[str, int] = {
    "agents": 58,
    "cad": 3,
    "dataset": 19,
    "drawing": 2,
    "envs": 46,
    "gan": 36,
    "parametric": 18,
    "planning": 19,
    "sim": 45,
    "slam": 29,
}
"""Fields of the classes of settings in each package. Commands are apart: each has 20 options at most."""
MORE_LINES: dict[str, int] = {}
MORE_PARAMETERS: dict[str, int] = {}
MORE_ATTRIBUTES: dict[str, int] = {
    "slamgym.agents.evaluation.trial.Trial": 17,
    "slamgym.commands.deforming.arguments.DeformArguments": 19,
    "slamgym.commands.generate.GenerateArguments": 18,
    "slamgym.dataset.record.PairRecord": 28,
    "slamgym.envs.batch.arrays.Robots": 18,
    "slamgym.envs.batch.arrays.Scenes": 20,
    "slamgym.envs.explore_frontiers_env.ExploreFrontiersEnv": 17,
    "slamgym.envs.records.StepRecord": 28,
    "slamgym.envs.rewards.RewardConfig": 16,
    "slamgym.planning.exploration_loop.ExplorationLoop": 16,
    "slamgym.ros2.mapping.MapNode": 16,
    "slamgym.sim.lidar.LidarConfig": 16,
    "slamgym.slam.config.SlamConfig": 22,
}
"""Settings and records whose fields are names in saved files or options of commands, and what still is to be split."""
NAMES_IN_TWO_MODULES: dict[str, int] = {}
"""Public names that are defined more than once, and how often."""


def definitions(kind: type) -> Iterator[tuple[str, ast.AST]]:
    """Every function or class of the package by ``module.name``."""
    for module in modules():
        for node in ast.walk(tree_of(module)):
            if isinstance(node, kind):
                yield f"{module}.{node.name}", node


def is_kernel(function: ast.FunctionDef) -> bool:
    """Whether numba compiles the function."""
    return any("kernel" in ast.unparse(decorator) for decorator in function.decorator_list)


def count_parameters(function: ast.FunctionDef) -> int:
    """Parameters that a caller may give, ``self`` and ``cls`` not counted."""
    given = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return len([argument for argument in given if argument.arg not in {"self", "cls"}])


def attributes(definition: ast.ClassDef) -> set[str]:
    """Fields of a class, and what its methods assign to ``self``."""
    fields = {node.target.id for node in definition.body if isinstance(node, ast.AnnAssign)}
    assigned = {
        node.attr
        for node in ast.walk(definition)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }
    return fields | assigned


NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def code_tokens(module: str) -> list[int]:
    """The line of each token of code: no docstring, comment or import."""
    passed_over: set[int] = set()
    for node in ast.walk(tree_of(module)):
        is_import = isinstance(node, ast.Import | ast.ImportFrom)
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if is_import or (is_text and isinstance(node.value.value, str)):
            passed_over.update(range(node.lineno, node.end_lineno + 1))
    source = io.StringIO(modules()[module].read_text())
    lines = [
        token.start[0]
        for token in tokenize.generate_tokens(source.readline)
        if token.type not in NO_CODE
    ]
    return [line for line in lines if line not in passed_over]


def public_names(module: str) -> set[str]:
    """Names that the body of a module binds and that don't begin with an underscore."""
    names = set()
    for node in tree_of(module).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names.update(target.id for target in targets if isinstance(target, ast.Name))
    return {name for name in names if not name.startswith("_")}


def check(found: dict[str, int], exceptions: dict[str, int], limit: int) -> None:
    """Compare what is over the limit with the exceptions that stand."""
    over = {name: count for name, count in found.items() if count > limit}
    assert over == exceptions, (
        f"over {limit}: {sorted(over.items() - exceptions.items())}; "
        f"lower or delete the exceptions {sorted(exceptions.items() - over.items())}"
    )


def test_files_are_short():
    check(
        {name: len(path.read_text().splitlines()) for name, path in modules().items()},
        MORE_LINES,
        MAX_LINES,
    )


def test_functions_take_few_parameters():
    found = {
        name: count_parameters(node)
        for name, node in definitions(ast.FunctionDef)
        if isinstance(node, ast.FunctionDef) and not is_kernel(node)
    }
    check(found, MORE_PARAMETERS, MAX_PARAMETERS)


def test_classes_have_few_attributes():
    found = {
        name: len(attributes(node))
        for name, node in definitions(ast.ClassDef)
        if isinstance(node, ast.ClassDef)
    }
    check(found, MORE_ATTRIBUTES, MAX_ATTRIBUTES)


def test_public_names_are_unique():
    names = collections.Counter(
        name
        for module in modules()
        for name in public_names(module)
        if not (name == "main" and room_of(f"{module}.") == "commands")
    )
    check(dict(names), NAMES_IN_TWO_MODULES, 1)


def fields_by_module(root: str) -> collections.Counter[str]:
    """How many fields the classes that descend from a class declare, module by module."""
    found = {name.rpartition(".")[2]: (name, node) for name, node in definitions(ast.ClassDef)}
    bases = {name: [ast.unparse(base) for base in node.bases] for name, (_, node) in found.items()}

    def descends(name: str) -> bool:
        return any(base == root or descends(base) for base in bases.get(name, ()))

    fields: collections.Counter[str] = collections.Counter()
    for name, (place, node) in found.items():
        if descends(name):
            declared = [
                ast.unparse(line.annotation)
                for line in node.body
                if isinstance(line, ast.AnnAssign)
            ]
            fields[place.rpartition(".")[0]] += sum("ClassVar" not in hint for hint in declared)
    return fields


def package_of(module: str) -> str:
    """The package that a module counts for; the face of slamgym for itself."""
    is_inside = "." in module and module not in NO_ROOM
    return room_of(module) if is_inside else "slamgym"


def tokens_by_package() -> dict[str, int]:
    """Tokens of code of each package."""
    found: collections.Counter[str] = collections.Counter()
    for module in modules():
        found[package_of(module)] += len(code_tokens(module))
    return dict(sorted(found.items()))


def settings_by_package() -> dict[str, int]:
    """Number of settings of each package that has any."""
    found: collections.Counter[str] = collections.Counter()
    fields = fields_by_module("Settings") - fields_by_module(
        "Arguments"
    )  # Arguments are Settings, too
    for module, count in fields.items():
        found[package_of(module)] += count
    return dict(sorted(found.items()))


def limit(stored: int) -> int:
    """What a stored size allows."""
    return math.ceil(stored * (1.0 + SLACK))


def check_growth(kind: str, table: str, found: dict[str, int], stored: dict[str, int]) -> None:
    """Compare the sizes of packages with what they had."""
    grown = [
        f"{package} has {count:,} {kind}, more than {limit(stored.get(package, 0)):,} "
        f"({stored.get(package, 0):,} and {SLACK:.0%} slack)"
        for package, count in found.items()
        if count > limit(stored.get(package, 0))
    ]
    assert not grown, (
        f"{'; '.join(grown)}. Say it more simply or delete what nothing needs, in this package only: formatting "
        f"doesn't change the count. If users need the new part, raise the package's entry of {table} in "
        "tests/test_ratchets.py to what `python tests/test_ratchets.py` prints, in a commit of its own that says why."
    )
    gone = stored.keys() - found.keys()
    assert not gone, f"delete {sorted(gone)} from {table}"


def test_packages_grow_little():
    check_growth("tokens of code", "TOKENS", tokens_by_package(), TOKENS)


def test_few_settings_are_added():
    check_growth("settings", "SETTINGS", settings_by_package(), SETTINGS)


def test_the_documentation_stays_readable():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    shown = {page: COMMENTS.sub(" ", page.read_text()) for page in pages}
    words = {str(page.relative_to(ROOT)): len(text.split()) for page, text in shown.items()}
    longest = sorted(words, key=lambda page: -words[page])[:5]
    assert sum(words.values()) <= MAX_WORDS, (
        f"{sum(words.values()):,} words, more than {MAX_WORDS:,}: shorten or delete; the longest pages: {longest}"
    )


def table(name: str, sizes: dict[str, int]) -> str:
    """A table of sizes as it stands in this file."""
    rows = "".join(f'    "{package}": {count},\n' for package, count in sizes.items())
    return f"{name}: dict[str, int] = {{\n{rows}}}\n"


if __name__ == "__main__":
    sys.stdout.write(table("TOKENS", tokens_by_package()))
    sys.stdout.write(table("SETTINGS", settings_by_package()))
    places = [f"{module}:{line}" for module in modules() for line in code_tokens(module)]
    sys.stdout.write(
        f"{len(places):,} tokens, {len(places) / len(set(places)):.2f} a line of code\n"
    )
