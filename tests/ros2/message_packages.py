"""Builds the messages of which no wheel exists (tf2_msgs, nav2_msgs, map_msgs) from the generators in ROS 2's wheels.

``make messages`` (a minute of CPU time) needs cmake, a C++ compiler and pip's registry; it leaves a
virtual environment of its own there, and ``setup.env``, the variables with which a program finds the messages. Tests
that need them are skipped without it.
"""

import os
import re
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from string import Template

WHEELS = (
    "ros-rclpy", "ros-nav-msgs", "ros-geometry-msgs", "ros-ament-cmake", "ros-ament-package",
    "ros-ament-cmake-include-directories", "ros-ament-cmake-ros", "ros-ament-cmake-ros-core",
    "ros-rosidl-core-generators", "catkin-pkg", "lark", "numpy",
)  # fmt: skip
PACKAGES = {
    "tf2_msgs": {"msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n"},
    "map_msgs": {
        "msg/OccupancyGridUpdate.msg": """\
std_msgs/Header header
int32 x
int32 y
uint32 width
uint32 height
int8[] data
"""
    },
    # As Nav2 has it on Jazzy.
    "nav2_msgs": {
        "action/NavigateToPose.action": """\
geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 NONE=0
uint16 UNKNOWN=9000
uint16 FAILED_TO_LOAD_BEHAVIOR_TREE=9001
uint16 TF_ERROR=9002
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
"""
    },
}
"""Files of each package."""
NEEDED = ("std_msgs", "geometry_msgs", "builtin_interfaces", "action_msgs")
"""Packages whose messages they are made of."""
_MANIFEST = Template("""\
<package format="3">
  <name>$name</name><version>0.0.0</version><description>messages</description>
  <maintainer email="nobody@example.com">nobody</maintainer><license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
</package>
""")
_LISTS = Template("""\
cmake_minimum_required(VERSION 3.16)
project($name)
find_package(ament_cmake REQUIRED)
find_package(rosidl_core_generators REQUIRED)
foreach(needed $needed)
  find_package($${needed} REQUIRED)
endforeach()
rosidl_generate_interfaces($${PROJECT_NAME} $files DEPENDENCIES $needed)
ament_package()
""")


def main(folder: Path) -> None:
    """Build all packages in a folder."""
    folder = folder.resolve()
    env = folder / "env"
    if not (folder / "setup.env").exists():
        venv.create(env, with_pip=True)
        _run([env / "bin" / "pip", "install", "--quiet", *WHEELS])
    _point_at_this_python(env)
    install = folder / "install"
    for name, files in PACKAGES.items():
        source = folder / name
        for path, text in files.items():
            (source / path).parent.mkdir(parents=True, exist_ok=True)
            (source / path).write_text(text)
        (source / "package.xml").write_text(_MANIFEST.substitute(name=name))
        lists = _LISTS.substitute(name=name, files=" ".join(files), needed=" ".join(NEEDED))
        (source / "CMakeLists.txt").write_text(lists)
        build = source / "build"
        environment = _environment(env)
        python = env / "bin" / "python"
        options = [f"-DCMAKE_PREFIX_PATH={env}", f"-DPython3_EXECUTABLE={python}"]
        options += [f"-DCMAKE_INSTALL_PREFIX={install}", "-DBUILD_TESTING=OFF"]
        _run(["cmake", "-S", source, "-B", build, *options], environment)
        _run(["cmake", "--build", build, "-j2"], environment)
        _run(["cmake", "--install", build], environment)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    (site,) = {path.parent for path in install.glob(f"**/{version}/*-packages/*")}
    variables = {
        "PYTHONPATH": site,
        "LD_LIBRARY_PATH": install / "lib",
        "AMENT_PREFIX_PATH": install,
    }
    lines = [f"{name}={value}\n" for name, value in variables.items()]
    (folder / "setup.env").write_text("".join(lines))


def _point_at_this_python(env: Path) -> None:
    """CMake files of the wheels name folders of the Python that they were built with."""
    (site,) = (env / "lib").glob("python*/site-packages")
    places = {
        r"/opt/python/[^;\"]*/include/python3\.\d+": sysconfig.get_paths()["include"],
        r"/opt/python/[^;\"]*/site-packages": str(site),
    }
    for path in (env / "share").rglob("*.cmake"):
        mended = text = path.read_text()
        for before, after in places.items():
            mended = re.sub(before, after, mended)
        if mended != text:
            path.write_text(mended)


def _environment(env: Path) -> dict[str, str]:
    """What CMake's programs need to find the wheels."""
    libraries = env / "lib"
    path = f"{env / 'bin'}{os.pathsep}{os.environ['PATH']}"
    prefix = {"AMENT_PREFIX_PATH": str(env), "LD_LIBRARY_PATH": str(libraries)}
    return os.environ | prefix | {"PATH": path}


def _run(words: list[object], environment: dict[str, str] | None = None) -> None:
    subprocess.run([str(word) for word in words], env=environment, check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
