"""Which package may import which: only what is needed, and no circles.

``ALLOWED`` is the whole list, each edge with what it is needed for. Everything may import ``core``, and ``commands``
may import everything; nothing else is free. The table in docs/architecture.md is made from this list:
``python tests/test_architecture.py`` writes it.
"""

import sys
from graphlib import CycleError, TopologicalSorter

from source_tree import ROOT, imported_names, imports_between_rooms, modules, room_of

PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- edges: begin -->", "<!-- edges: end -->"

ROOMS = {
    "core": "records, SE(2), errors, settings, files, progress, parallel engines, intervals",
    "metrics": "every measure: trajectories, relations, maps, walls, rooms, two-sample tests",
    "interop": "ROS maps, maps of robot vacuums, CARMEN logs, TUM trajectories, ROS bags",
    "cad": "floor plans: readers (DXF, IFC, GeoJSON, HouseExpo, pictures), generator, rasters",
    "sim": "world and sensors: robot, contacts, furniture, people, laser, wheel odometry",
    "slam": "graph SLAM (`slam/graph`), GMapping's particle filter, localisation, laser odometry; log replay",
    "planning": "costmap, paths, frontiers, navigation, the exploration loop",
    "viz": "text, sheets, overlays, films, the window: plain records in, pictures out",
    "parametric": "SLAM maps along a path without exploring; the paper's CAD -> SLAM model",
    "envs": "the Gymnasium environments and the episodes that are run in them",
    "dataset": "the dataset format; generating, curating and rendering",
    "agents": "explorers, their training and their evaluation",
    "gan": "translators between SLAM maps and CAD maps",
    "drawing": "from a SLAM map to vectors with dimensions and CAD files; comparison with a plan",
    "ros2": "ROS 2 nodes: the simulated robot, the mapper, the explorers",
    "commands": "the command line",
}

ALLOWED = {
    ("cad", "interop"): "a ROS map is a floor plan, too",
    ("sim", "cad"): "the world is built from a floor plan",
    ("slam", "interop"): "recorded logs are replayed",
    ("slam", "metrics"): "a replay is measured; loop closures compare relative poses",
    ("viz", "cad"): "floor plans are drawn",
    ("viz", "metrics"): "errors of walls are coloured",
    ("parametric", "cad"): "floor plans are deformed",
    ("parametric", "envs"): "settings of the robot whose maps are drawn",
    ("parametric", "interop"): "recorded paths are read",
    ("parametric", "planning"): "paths are planned on a roadmap",
    ("parametric", "sim"): "the robot's world and sensors",
    ("parametric", "slam"): "the robot's mapper",
    ("envs", "cad"): "buildings are explored",
    ("envs", "interop"): "an episode is a log",
    ("envs", "metrics"): "the map's error is a reward and a figure",
    ("envs", "planning"): "decisions are carried out by the navigation stack",
    ("envs", "sim"): "world and sensors are stepped",
    ("envs", "slam"): "the robot maps",
    ("envs", "viz"): "episodes are rendered",
    ("dataset", "cad"): "plans are explored, drawn and compared",
    ("dataset", "envs"): "explorations are run",
    ("dataset", "interop"): "logs and paths are kept with the pairs",
    ("dataset", "metrics"): "pairs are measured",
    ("dataset", "sim"): "recipes vary noise and furniture",
    ("dataset", "viz"): "contact sheets",
    ("agents", "cad"): "explorers are trained and evaluated on plans; the oracle knows them",
    ("agents", "envs"): "explorers act in environments",
    ("agents", "metrics"): "trials are measured",
    ("agents", "planning"): "rules choose, the exploration loop drives",
    ("agents", "viz"): "coverage curves and videos are rendered",
    ("agents", "sim"): "the oracle casts rays into the plan",
    ("gan", "interop"): "ROS maps are translated",
    ("gan", "metrics"): "translations are measured",
    ("gan", "viz"): "translations are shown",
    ("drawing", "cad"): "a drawing is a floor plan, too; maps are compared with floor plans",
    ("drawing", "gan"): "cleaning or a translator finds the floor, and the walls' direction",
    ("drawing", "interop"): "a drawing is a ROS map, too",
    ("drawing", "metrics"): "rooms are parts that only a doorway joins",
    ("drawing", "viz"): "drawings and comparisons are shown over their maps",
    ("ros2", "agents"): "the explorers choose",
    ("ros2", "cad"): "the simulated robot drives in a floor plan",
    ("ros2", "envs"): "the simulated robot is the environment's",
    ("ros2", "interop"): "messages are read and written as in bags; maps are saved",
    ("ros2", "planning"): "the exploration loop decides, the navigation drives",
    ("ros2", "sim"): "the simulated robot has a laser",
    ("ros2", "slam"): "the robot maps",
    ("ros2", "viz"): "an exploration is recorded and filmed",
}
BLIND = ("slam", "planning")
"""Packages that hold beliefs: they must not be able to see what is true."""
OF_EXTRAS = (
    "slamgym.agents",
    "slamgym.gan",
    "slamgym.ros2",
    "slamgym.commands.agents",
    "slamgym.commands.gan",
)
TRUTH = {"cad", "sim", "parametric", "envs", "dataset"}


def needs_permission(pair: tuple[str, str]) -> bool:
    """Whether an edge must stand in the list."""
    return pair[0] != "commands" and pair[1] != "core"


def test_packages_import_only_what_the_list_allows():
    wrong = {
        pair: sorted(names)
        for pair, names in imports_between_rooms().items()
        if needs_permission(pair) and pair not in ALLOWED
    }
    assert not wrong, f"not in ALLOWED: {wrong}"


def test_every_allowed_edge_is_needed():
    idle = ALLOWED.keys() - imports_between_rooms().keys()
    assert not idle, f"nothing uses {sorted(idle)}: delete them from ALLOWED"


def test_belief_cannot_see_truth():
    assert not {(first, second) for first, second in ALLOWED if first in BLIND and second in TRUTH}


def test_every_package_has_a_line():
    packages = {room_of(name) for name in modules() if name.count(".") > 1}
    assert packages - {"__main__"} == set(ROOMS)


def test_no_module_takes_part_in_a_circle_of_imports():
    graph = {
        module: {name for name in imported_names(module) if name in modules() and name != module}
        for module in modules()
    }
    # A package's face imports its modules so that users need not know them; its modules don't need the face.
    for module, targets in graph.items():
        targets -= {module.rsplit(".", 1)[0], "slamgym"}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(f"circle of imports: {' -> '.join(reversed(error.args[1]))}") from None


def test_the_base_install_needs_no_extra():
    for module in modules():
        if not module.startswith(OF_EXTRAS):
            heads = {name.split(".")[0] for name in imported_names(module)}
            assert not heads & {"torch", "stable_baselines3", "sb3_contrib", "rclpy"}, module


def table() -> str:
    """The packages in the order of their floors, with the packages that each may import, as Markdown."""
    rows = ["| package | content | may import, besides `core` |", "|---|---|---|"]
    for room, holds in ROOMS.items():
        seen = ", ".join(f"`{second}`" for first, second in ALLOWED if first == room)
        rows.append(
            f"| `{room}` | {holds} | {'everything' if room == 'commands' else seen or 'nothing'} |"
        )
    return "\n".join(rows)


def page_with_table() -> str:
    """docs/architecture.md as it should be."""
    head, rest = PAGE.read_text().split(BEGIN)
    return f"{head}{BEGIN}\n{table()}\n{END}{rest.split(END)[1]}"


def test_the_documentation_shows_this_list():
    assert PAGE.read_text() == page_with_table(), "run: python tests/test_architecture.py"


if __name__ == "__main__":
    PAGE.write_text(page_with_table())
    sys.exit()
