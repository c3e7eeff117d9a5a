"""Sizes that may only shrink: a limit for everybody, and the exceptions that stand today, each with its figure.

An exception that has shrunk must be lowered here, and one that is within the limit deleted, so that it can't grow
again. The budget of each package, command and page is what it took when it was last lowered:
``python tests/test_ratchets.py`` prints what all of them take now. A budget is raised only in a commit of its own that
says why a user needs it, and the sum of the packages' lines never rises.
"""

import ast
import collections
import io
import sys
import tokenize
from collections.abc import Iterator

from source_tree import ROOT, modules, room_of, tree_of

MAX_FILES_IN_A_FOLDER = 25
MAX_LINES = 400
MAX_PARAMETERS = 8
MAX_ATTRIBUTES = 15

BUDGET: dict[str, tuple[int, int, int, int, int]] = {
    "CONTRIBUTING.md": (0, 0, 0, 0, 1150),
    "README.md": (0, 0, 0, 0, 1141),
    "agents": (2444, 42, 0, 99, 0),
    "cad": (2096, 3, 0, 101, 0),
    "commands": (2480, 0, 211, 57, 0),
    "core": (1725, 0, 0, 74, 0),
    "dataset": (2678, 19, 0, 76, 0),
    "docs": (0, 0, 0, 0, 22529),
    "docs/drawing": (0, 0, 0, 0, 3890),
    "docs/notes": (0, 0, 0, 0, 3670),
    "docs/tutorials": (0, 0, 0, 0, 431),
    "drawing": (2331, 2, 0, 137, 0),
    "envs": (2538, 33, 0, 51, 0),
    "gan": (2157, 33, 0, 74, 0),
    "interop": (1209, 0, 0, 43, 0),
    "metrics": (1141, 0, 0, 68, 0),
    "parametric": (863, 17, 0, 28, 0),
    "planning": (2025, 19, 0, 79, 0),
    "ros2": (1514, 0, 30, 40, 0),
    "sim": (2222, 45, 0, 156, 0),
    "slam": (3324, 29, 0, 195, 0),
    "slamgym": (19, 0, 0, 0, 0),
    "viz": (784, 0, 0, 61, 0),
}
"""Lines of code (without docstrings, comments, blank lines and imports), settings, options of commands, constants and
words: of each package, and of the pages in each folder of documentation."""
TOTAL = (31550, 242, 241, 1339, 32811)
"""Of all of them together; it never rises."""
MORE_LINES: dict[str, int] = {}
MORE_PARAMETERS: dict[str, int] = {}
MORE_ATTRIBUTES: dict[str, int] = {
    "slamgym.agents.evaluation.trial.Trial": 17,
    "slamgym.commands.deforming.arguments.DeformArguments": 17,
    "slamgym.commands.generate.GenerateArguments": 17,
    "slamgym.dataset.record.PairRecord": 28,
    "slamgym.envs.explore_env.ExploreEnv": 18,
    "slamgym.envs.simulation.SimulatedRobot": 17,
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


def count_code_lines(module: str) -> int:
    """Lines that hold code: no docstring, comment, blank line or import."""
    passed_over: set[int] = set()
    for node in ast.walk(tree_of(module)):
        is_import = isinstance(node, ast.Import | ast.ImportFrom)
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if is_import or (is_text and isinstance(node.value.value, str)):
            passed_over.update(range(node.lineno, node.end_lineno + 1))
    thin = {
        tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
    }  # fmt: skip
    source = io.StringIO(modules()[module].read_text())
    held = set()
    for token in tokenize.generate_tokens(source.readline):
        if token.type not in thin:
            held.update(range(token.start[0], token.end[0] + 1))
    return len(held - passed_over)


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


def test_folders_are_small():
    files = collections.Counter(path.parent for path in modules().values())
    for folder in ("tests", "benchmarks"):
        files.update(path.parent for path in (ROOT / folder).rglob("*.py"))
    check(
        {str(folder.relative_to(ROOT)): count for folder, count in files.items()},
        {},
        MAX_FILES_IN_A_FOLDER,
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


def count_constants(module: str) -> int:
    """Names in capital letters that the body of a module binds."""
    targets = [
        target
        for node in tree_of(module).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
    ]
    names = [
        name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)
    ]
    return sum(name.isupper() for name in names)


def sizes() -> dict[str, tuple[int, ...]]:
    """Sizes of all packages and folders of documentation now, in the order of the budget."""
    found: dict[str, list[int]] = collections.defaultdict(lambda: [0] * 5)
    options = fields_by_module("Arguments")
    settings = fields_by_module("Settings") - options  # Arguments are Settings, too
    for module in modules():
        own = module.split(".")[1] if module.count(".") > 1 or module in WITH_MODULES else "slamgym"
        counts = (
            count_code_lines(module),
            settings[module],
            options[module],
            count_constants(module),
        )
        for index, count in enumerate(counts):
            found[own][index] += count
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
        place = page.relative_to(ROOT)
        found[str(place.parent if place.parent.name else place)][4] += len(page.read_text().split())
    return {name: tuple(counts) for name, counts in sorted(found.items())}


def total(table: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Sums of the columns."""
    return tuple(map(sum, zip(*table.values(), strict=True)))


WITH_MODULES = {
    name for name, path in modules().items() if path.name == "__init__.py" and name.count(".") == 1
}
"""Packages, as told from modules next to them."""


def test_nothing_outgrows_its_budget():
    found = sizes()
    nothing = (0, 0, 0, 0, 0)
    over = {
        name: (counts, BUDGET.get(name))
        for name, counts in found.items()
        if any(
            count > limit for count, limit in zip(counts, BUDGET.get(name, nothing), strict=True)
        )
    }
    assert not over, f"(now, budget): {over}"
    assert not BUDGET.keys() - found.keys(), f"delete {sorted(BUDGET.keys() - found.keys())}"


def test_the_budgets_together_never_rise():
    assert all(given <= most for given, most in zip(total(BUDGET), TOTAL, strict=True))


if __name__ == "__main__":
    now = sizes()
    for name, counts in now.items():
        sys.stdout.write(f'    "{name}": {counts},\n')
    sys.stdout.write(f"TOTAL = {total(now)}\n")
