"""A dataset with several sources of plans, several trajectories a plan and drawn conditions."""

import dataclasses
import json

import pytest
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.core.config import from_dict
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig, Layout, build_dataset, read_manifest
from slamgym.dataset.generate.recipe import Recipe, parse_recipe
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.slam import SlamConfig

BASE = EpisodeConfig(minutes=0.2, env=ExploreConfig(slam=SlamConfig(particles=3)))
RECIPE = {
    "odometry": ["ideal", "high"],
    "explorer": ["nearest", "cost_utility"],
    "scanner": [{"set": {"lidar.range_max": 1.5, "slam.max_usable_range": 1.2}}],
}


class OnePlan:
    ids = ("flat",)

    def __len__(self):
        return 1

    def load(self, plan_id):
        return FloorPlan(plan_id, box(0, 0, 3.0, 2.4))


def build(root, recipe=RECIPE, pairs=4, workers=1, **settings):
    config = DatasetConfig(
        seed=2, episode=BASE, recipe=parse_recipe(recipe, "test"), trajectories=3, **settings
    )
    execution = Execution(workers, "in_process" if workers == 1 else "local")
    return build_dataset(root, OnePlan(), config, make_explorer, pairs=pairs, execution=execution)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("varied")
    build(root)
    return root


def test_what_was_drawn_is_recorded_and_has_its_effect(dataset):
    recipe = parse_recipe(RECIPE, "test")
    records = list(read_manifest(dataset))
    assert {record.conditions["odometry"] for record in records} == {"ideal", "high"}
    for record in records:
        assert recipe.draw(record.seed).items() <= record.conditions.items()
        assert record.explorer == record.conditions["explorer"]
        assert record.conditions["slam.particles"] == 3  # set by the user, not drawn
        # Ideal odometry errs by nothing; the high level by centimetres within 12 seconds.
        assert (record.odometry_ate < 1e-6) == (record.conditions["odometry"] == "ideal")


def test_the_scanner_reaches_the_log(dataset):
    from slamgym.interop import open_log

    name = next(iter(read_manifest(dataset))).name
    assert open_log(Layout(dataset).episode(name)).geometry.range_max == pytest.approx(1.5)


def test_the_number_of_workers_and_interruptions_do_not_matter(dataset, tmp_path):
    build(tmp_path, pairs=2, workers=2)
    build(tmp_path, pairs=4)
    assert Layout(tmp_path).manifest.read_bytes() == Layout(dataset).manifest.read_bytes()
    sums = [
        [
            (path.parent.name, path.read_bytes())
            for path in sorted(Layout(root).episodes.glob("*/SHA256SUMS"))
        ]
        for root in (dataset, tmp_path)
    ]
    assert len(sums[0]) == 4
    assert sums[0] == sums[1]


def test_another_recipe_is_refused_and_the_settings_name_it(dataset):
    with pytest.raises(ConfigError, match="recipe"):
        build(dataset, {**RECIPE, "odometry": ["ideal", "medium"]})
    saved = json.loads(Layout(dataset).config.read_text())
    assert saved["trajectories"] == 3
    assert [choice["settings"] for choice in saved["recipe"]["factors"]["odometry"]] == [
        {"odometry": "ideal"},
        {"odometry": "high"},
    ]
    assert from_dict(Recipe, saved["recipe"]) == parse_recipe(RECIPE, "test")


def test_an_unknown_explorer_in_a_recipe_is_found_before_any_work(tmp_path):
    with pytest.raises(ConfigError, match="did you mean 'nearest'"):
        build(tmp_path / "out", {"explorer": ["cost_utility", "nearst"]})
    assert not (tmp_path / "out").exists()


def test_senseless_numbers_of_trajectories_are_refused():
    with pytest.raises(ConfigError, match="trajectories must be at least 1"):
        DatasetConfig(trajectories=0)


def test_the_command_line_takes_sources_weights_recipe_and_trajectories(tmp_path, capsys):
    for folder, names in (("one", "ab"), ("two", "cd")):
        for name in names:
            write_houseexpo(
                tmp_path / folder / f"{name}.json", FloorPlan(name, box(0, 0, 3.0, 2.4))
            )
    (tmp_path / "recipe.yaml").write_text("clutter.people: [0, 1]\n")
    out = tmp_path / "out"
    command = [
        "generate", "--plans", f"{tmp_path / 'one'}=2", "--plans", str(tmp_path / "two"), "--recipe",
        str(tmp_path / "recipe.yaml"), "--trajectories", "2", "--minutes", "0.1", "--set", "particles=3",
        "--pairs", "6", "--engine", "in_process", "--out", str(out),
    ]  # fmt: skip
    assert cli.main(command) == 0
    records = list(read_manifest(out))
    plans = [record.plan_id for record in records]
    assert plans[::2] == plans[1::2]
    assert sum(plan_id in "ab" for plan_id in plans) == 4
    assert [record.repetition for record in records] == [0, 1] * 3
    assert json.loads(Layout(out).config.read_text())["plans"][0]["weight"] == 2.0
    assert cli.main([*command, "--set", "clutter.people=1"]) == 2
    assert "clutter.people is set, but the recipe varies it" in capsys.readouterr().err


def test_a_dataset_config_is_the_same_whether_a_recipe_is_empty_or_missing():
    assert DatasetConfig() == dataclasses.replace(DatasetConfig(), recipe=Recipe({}))
