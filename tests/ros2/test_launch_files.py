"""The launch files hold commands that exist, with options and parameters that exist and take the values there."""

import contextlib
import dataclasses
import io
import re
import shlex
import typing
from xml.etree import ElementTree as ET

import pytest
import tyro
import yaml
from source_tree import ROOT

from slamgym.commands import cli, ros2

FILES = sorted((ROOT / "slamgym" / "ros2" / "launch").glob("*.launch.xml"))
VARIABLE = re.compile(r"\$\(var (\w+)\)")


def defaults_of(tree):
    """The arguments that a launch file declares, with their values where nobody sets them."""
    return {arg.get("name"): arg.get("default") for arg in tree.findall("arg")}


def commands_of(tree):
    """(name of the node's command, words of the options, words for ROS) of all that a launch file runs."""
    defaults = defaults_of(tree)
    for entry in tree.iter("executable"):
        # As launch does it: a variable belongs to the word that it stands in, and quotes can't span it.
        words = [
            VARIABLE.sub(lambda found: defaults[found[1]], word)
            for word in shlex.split(guarded(entry.get("cmd")))
        ]
        assert words[:2] == ["slamgym", "ros2"]
        end = words.index("--ros-args") if "--ros-args" in words else len(words)
        yield words[2], words[3:end], words[end + 1 :]


def guarded(command):
    """A command whose words don't fall apart at the blank in a variable."""
    return VARIABLE.sub(lambda found: f"'{found[0]}'", command)


def arguments_class(name):
    """What the command of a node takes."""
    return typing.get_type_hints(
        getattr(ros2, cli.COMMANDS[f"ros2 {name}"].target.partition(":")[2])
    )["arguments"]


def parsed(name, options):
    """The arguments of a node's command, by what its command line says."""
    complaint = io.StringIO()
    with contextlib.redirect_stderr(complaint), contextlib.redirect_stdout(complaint):
        try:
            return tyro.cli(
                arguments_class(name), args=options, config=(tyro.conf.FlagCreatePairsOff,)
            )
        except SystemExit:
            pytest.fail(complaint.getvalue())


@pytest.fixture(params=FILES, ids=lambda path: path.name)
def tree(request):
    return ET.parse(request.param).getroot()


def test_there_are_launch_files():
    assert {path.name for path in FILES} == {
        "demo.launch.xml",
        "nav2.launch.xml",
        "team.launch.xml",
        "turtlebot3.launch.xml",
    }


def test_options_and_parameters_exist_and_take_their_values(tree):
    found = list(commands_of(tree))
    assert found
    for name, options, ros in found:
        arguments = parsed(name, options)
        pairs = list(zip(ros[::2], ros[1::2], strict=True))
        renamed = [word for flag, word in pairs if flag != "-p"]
        assert all(word.startswith("__ns:=/") for word in renamed), "read more of ROS's arguments"
        given = dict(word.split(":=") for flag, word in pairs if flag == "-p")
        given.pop("use_sim_time", None)
        dataclasses.replace(
            arguments, **{key: yaml.safe_load(value) for key, value in given.items()}
        )


def test_every_argument_is_declared_and_used(tree):
    text = ET.tostring(tree, encoding="unicode")
    assert set(VARIABLE.findall(text)) == set(defaults_of(tree))


def test_an_argument_that_a_node_has_too_has_its_default(tree):
    ours = {
        "return_to_start",
        "speed",
        "out",
    }  # a robot that is left alone comes back; a demo is watched
    for name, _, _ in commands_of(tree):
        fields = {field.name: field.default for field in dataclasses.fields(arguments_class(name))}
        for argument, value in defaults_of(tree).items():
            if argument in fields.keys() - ours:
                assert yaml.safe_load(value or "''") == fields[argument], f"{name}: {argument}"


def test_nodes_of_a_simulated_robot_go_by_its_clock():
    for name, _, ros in commands_of(ET.parse(FILES[0]).getroot()):
        assert ("use_sim_time:=true" in ros) == (name != "sim")
