"""Variety by configuration: drawn by weight, from the seed alone, and refused where it makes no sense."""

import json
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.agents.registry import make_explorer
from slamgym.cad import generate_plan
from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.dataset.generate.build import DatasetConfig
from slamgym.dataset.generate.recipe import (
    RECIPES,
    Choice,
    Recipe,
    apply_conditions,
    episode_conditions,
    known_settings,
    open_recipe,
    parse_recipe,
    setting_value,
)
from slamgym.dataset.record import PairConfig, make_pair
from slamgym.envs.episode import EpisodeConfig, run_episode
from slamgym.sim import lidar_level, odometry_level
from slamgym.slam import SlamConfig

PLAIN = {
    "explorer": ["explore_lite", {"value": "nearest", "weight": 3}],
    "slam.particles": [{"between": [5, 8]}],
    "clutter.furniture": [{"value": 0.0, "weight": 1}, {"between": [0.25, 0.75], "weight": 1}],
    "scanner": [
        {"set": {"lidar.range_max": 3.5, "slam.max_usable_range": 3.0}},
        {"set": {"lidar.range_max": 8.0, "slam.max_usable_range": 7.0}},
    ],
}
RECIPE = parse_recipe(PLAIN, "test")


@given(st.integers(0, 2**63 - 1))
def test_a_draw_is_one_of_the_choices_and_follows_from_the_seed(seed):
    drawn = RECIPE.draw(seed)
    assert drawn == RECIPE.draw(seed)
    assert drawn["explorer"] in ("explore_lite", "nearest")
    assert drawn["slam.particles"] in (5, 6, 7, 8)
    assert drawn["clutter.furniture"] == 0.0 or 0.25 <= drawn["clutter.furniture"] <= 0.75
    assert (drawn["lidar.range_max"], drawn["slam.max_usable_range"]) in ((3.5, 3.0), (8.0, 7.0))


def test_weights_are_kept():
    draws = [RECIPE.draw(seed) for seed in range(2000)]
    # Binomial with n = 2000: four standard deviations are 0.039 at p = 0.75 and 0.045 at 0.5.
    assert sum(d["explorer"] == "nearest" for d in draws) / 2000 == pytest.approx(0.75, abs=0.039)
    assert sum(d["lidar.range_max"] == 8.0 for d in draws) / 2000 == pytest.approx(0.5, abs=0.045)
    assert set(Counter(d["slam.particles"] for d in draws)) == {5, 6, 7, 8}
    # Factors are drawn apart from each other.
    both = sum(d["explorer"] == "nearest" and d["lidar.range_max"] == 8.0 for d in draws) / 2000
    assert both == pytest.approx(0.375, abs=0.044)


def test_a_factor_more_does_not_change_the_others():
    less = parse_recipe({name: PLAIN[name] for name in ("explorer", "scanner")}, "test")
    for seed in range(50):
        assert less.draw(seed).items() <= RECIPE.draw(seed).items()


def test_what_is_drawn_reaches_the_settings_and_the_record():
    config, conditions = episode_conditions(RECIPE, EpisodeConfig(), 7)
    for name, value in conditions.items():
        if name not in ("odometry",):
            assert setting_value(config, name) == value
    assert conditions["odometry"] == "medium"
    assert conditions["clutter.people"] == 0
    _, plain = episode_conditions(Recipe(), EpisodeConfig(), 7)
    assert plain["explorer"] == "rl"
    assert plain["slam.particles"] == 30


def test_levels_come_before_single_settings():
    config = apply_conditions(EpisodeConfig(), {"odometry.slip_distance": 0.5, "odometry": "low"})
    assert config.env.odometry.slip_distance == 0.5
    assert config.env.odometry.slip_turn == odometry_level("low").slip_turn


def test_every_known_name_can_be_read():
    for name in known_settings():
        setting_value(EpisodeConfig(), name)


@pytest.mark.parametrize(
    ("plain", "words"),
    [
        (
            {"slam.particels": [5]},
            "test: slam.particels: unknown setting .* did you mean 'slam.particles'",
        ),
        ({"explorer": ["a"], "robo.radius": [1]}, "did you mean 'robot.radius'"),
        ({"reward.coverage": [1.0]}, "unknown setting 'reward.coverage'"),
        ({"slam.particles": ["many"]}, "slam.particles must be of type int, not 'many'"),
        ({"slam.particles": [0]}, r"slam.particles must be in \[1, 10000\], not 0"),
        ({"slam.mode": ["rbfp"]}, "not 'rbfp'; did you mean 'rbpf'"),
        ({"odometry": ["hihg"]}, "did you mean 'high'"),
        ({"odometry": [3]}, "must be the name of an error level"),
        ({"explorer": []}, "give a list"),
        ({"explorer": "nearest"}, "give a list"),
        ({"explorer": [{"value": "nearest", "wieght": 2}]}, "did you mean 'weight'"),
        ({"explorer": [{"value": "nearest", "weight": 0}]}, "weight must be a number above 0"),
        ({"explorer": [{"weight": 2}]}, "either a 'value'"),
        ({"clutter.furniture": [{"between": [0.5, 0.2]}]}, "the smaller first"),
        (
            {"clutter.furniture": [{"between": [0.5, 3.2]}]},
            r"clutter.furniture must be in \[0, 3\], not 3.2",
        ),
        ({"scanner": [{"set": {}}]}, "'set' takes settings"),
        (
            {"x": [{"set": {"slam.particles": 3}}], "slam.particles": [5]},
            "both set 'slam.particles'",
        ),
        (
            {"explorer": ["rl@98%:95%", "own:make"]},
            "'own:make' is code of your own, .* give it by --explorer",
        ),
        (
            {"x": [{"set": {"explorer": "own:make@98%:95%"}}]},
            "no recipe may run; give it by --explorer",
        ),
    ],
)
def test_a_senseless_recipe_is_one_error_that_names_the_place(plain, words):
    with pytest.raises(ConfigError, match=words) as caught:
        parse_recipe(plain, "test")
    assert str(caught.value).startswith("test: ")


def test_a_recipe_may_name_weights_and_promises():
    names = [
        "rl@98%:95%",
        "rl:weights.safetensors",
        "wheels:own/weights.safetensors",
        "tour@2m2:90%",
    ]
    assert parse_recipe({"explorer": names}, "test").values("explorer") == names


def test_yaml_and_json_say_the_same(tmp_path):
    (tmp_path / "r.json").write_text(json.dumps(PLAIN))
    (tmp_path / "r.yaml").write_text(json.dumps(PLAIN, indent=1))
    assert open_recipe(str(tmp_path / "r.json")) == open_recipe(str(tmp_path / "r.yaml")) == RECIPE


def test_the_reference_recipe_varies_what_it_promises():
    recipe = open_recipe("reference")
    assert {
        "explorer",
        "odometry",
        "lidar.range_max",
        "clutter.furniture",
        "clutter.people",
    } < recipe.settings
    assert set(recipe.values("odometry")) == {"ideal", "low", "medium", "high"}
    assert not any(name.startswith("slam.mode") for name in recipe.settings)  # the default mapper's


def test_a_mixture_draws_what_each_recipe_alone_would_draw():
    mixture = open_recipe("edition2")
    drawn = [mixture.draw(seed) for seed in range(100)]
    for seed, settings in enumerate(drawn):
        name = settings.pop("recipe")
        assert settings == open_recipe(name).draw(seed)
    config, conditions = episode_conditions(mixture, EpisodeConfig(), 3)
    assert conditions["recipe"] in {"reference", "real", "paper", "paper360", "quick"}
    assert apply_conditions(EpisodeConfig(), conditions) == config
    counts = Counter(mixture.draw(seed)["recipe"] for seed in range(300))
    assert counts.most_common(1)[0][0] == "reference"
    assert from_dict(Recipe, to_dict(mixture)) == mixture


def test_a_mixture_in_a_mixture_and_an_unknown_recipe_are_refused(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("recipe: [{value: edition2}, {value: quick}]")
    with pytest.raises(ConfigError, match="edition2/recipe: a mixture can't hold another"):
        open_recipe(str(path))
    path.write_text("recipe: [{value: refrence}]")
    with pytest.raises(ConfigError, match="did you mean 'reference'"):
        open_recipe(str(path))
    path.write_text("recipe: [{value: mine.yaml}]".replace("mine.yaml", str(path)))
    with pytest.raises(ConfigError, match="a mixture can't hold another"):
        open_recipe(str(path))


def test_mixed_recipes_may_be_named_alone_and_set_with_others(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("recipe: [quick, paper]")
    drawn = [open_recipe(str(path)).draw(seed) for seed in range(20)]
    assert {settings["recipe"] for settings in drawn} == {"quick", "paper"}
    assert all("odometry" in settings for settings in drawn)
    path.write_text("both: [{set: {recipe: quick, minutes: 3}}]")
    settings = open_recipe(str(path)).draw(1)
    assert settings == open_recipe("quick").draw(1) | {"recipe": "quick", "minutes": 3}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("recipe: 5", "recipe: give a list"),
        ("recipe: quick", "recipe: give a list"),
        ("scan/ner: [{set: {lidar.range_max: 8.0}}]", "a name holds no '/'"),
    ],
)
def test_what_is_no_list_of_recipes_is_refused(tmp_path, content, words):
    path = tmp_path / "mine.yaml"
    path.write_text(content)
    with pytest.raises(ConfigError, match=words):
        open_recipe(str(path))


def test_the_quick_recipe_varies_the_same_without_people():
    quick = open_recipe("quick")
    reference = open_recipe("reference")
    assert reference.settings - quick.settings == {"clutter.people"}
    for key in ("odometry", "lidar.range_max", "slam.max_usable_range"):
        assert set(quick.values(key)) == set(reference.values(key))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("r.yaml", "[1, 2", "is not valid yaml"),
        ("r.yaml", "just words", "is no recipe"),
        ("r.json", "", "is no recipe"),
    ],
)
def test_a_file_that_is_no_recipe_is_named(tmp_path, name, content, words):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputFileError, match=words):
        open_recipe(str(tmp_path / name))


def test_unknown_recipes_and_missing_files_are_named(tmp_path):
    with pytest.raises(ConfigError, match="did you mean 'reference'"):
        open_recipe("refrence")
    with pytest.raises(InputFileError, match=r"gone\.yaml"):
        open_recipe(str(tmp_path / "gone.yaml"))


def test_a_folder_of_a_recipes_name_does_not_hide_the_recipe(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reference").mkdir()  # what `generate --recipe reference --out reference` has begun
    assert open_recipe("reference").factors == open_recipe(str(RECIPES / "reference.yaml")).factors


def test_a_setting_that_the_recipe_would_draw_over_is_refused():
    recipe = Recipe({"explorer": (Choice({"explorer": "nearest"}),)})
    DatasetConfig(recipe=recipe)
    with pytest.raises(ConfigError, match="explorer is set, but the recipe varies it"):
        DatasetConfig(recipe=recipe, episode=EpisodeConfig(explorer="cost_utility"))


@pytest.mark.parametrize(
    ("name", "beams", "view"), [("paper", 180, 180.0), ("paper360", 360, 360.0)]
)
def test_the_papers_recipes_have_gazebos_laser_and_true_odometry(name, beams, view):
    recipe = open_recipe(name)
    for seed in range(4):
        config = apply_conditions(EpisodeConfig(), recipe.draw(seed))
        assert (config.env.lidar.num_beams, config.env.lidar.field_of_view_deg) == (beams, view)
        assert config.env.lidar == lidar_level("gazebo", config.env.lidar)
        assert config.env.lidar.sigma == 0.01
        assert config.env.odometry == odometry_level("ideal")
        assert config.env.slam.no_return == "ignore"


def test_the_paper_maps_by_gmapping_and_people_by_three_programs():
    assert (
        apply_conditions(EpisodeConfig(), open_recipe("paper").draw(0)).env.slam
        == SlamConfig.gmapping()
    )
    recipe = open_recipe("paper360")
    drawn = [apply_conditions(EpisodeConfig(), recipe.draw(seed)) for seed in range(60)]
    assert {config.explorer for config in drawn} == {"simulated_operator"}
    thresholds = [config.env.slam.occupied_threshold for config in drawn]
    assert {0.25, 0.166, 0.1} == set(thresholds)
    assert all(
        config.env.slam == SlamConfig.gmapping()
        for config, threshold in zip(drawn, thresholds, strict=True)
        if threshold == 0.25
    )
    assert 0.25 < thresholds.count(0.25) / 60 < 0.55


def test_the_real_recipe_draws_lasers_glass_and_robots_that_stop_early():
    recipe = open_recipe("real")
    drawn = [recipe.draw(seed) for seed in range(200)]
    assert {draw["lidar"] for draw in drawn} == {"real"}
    assert {draw.get("lidar.field_of_view_deg", 180.0) for draw in drawn} == {
        180.0,
        240.0,
        270.0,
        360.0,
    }
    for draw in drawn:
        assert 3.5 <= draw["lidar.range_max"] <= 30.0
        assert draw["slam.max_usable_range"] <= draw["lidar.range_max"]
        assert 0.5 <= draw["minutes"] <= 12.0
        assert 0.0 < draw["lidar.sweep"] <= 0.2
    applied = apply_conditions(EpisodeConfig(), drawn[0])
    assert applied.env.lidar.surfaces.mirrors == drawn[0]["lidar.surfaces.mirrors"]
    assert len({draw["turn_deg"] for draw in drawn}) > 100
    assert 0.3 < sum(draw["slam.mode"] == "rbpf" for draw in drawn) / 200 < 0.7


def test_an_exploration_by_the_real_recipe_is_the_same_again():
    recipe = open_recipe("real")
    plan = generate_plan(2)
    seed = next(seed for seed in range(1000) if recipe.draw(seed)["minutes"] < 0.7)
    settings, _ = episode_conditions(recipe, EpisodeConfig(), seed)
    first, again = (run_episode(plan, seed, settings, make_explorer) for _ in range(2))
    assert first.finished == "time_limit"
    assert (first.slam_map.cells == again.slam_map.cells).all()
    assert (first.truth.poses == again.truth.poses).all()


def test_buildings_are_turned_by_the_recipe():
    plan = generate_plan(2)
    recipe = parse_recipe(
        {"turn_deg": [{"between": [20.0, 60.0]}], "minutes": [0.1], "slam.resolution": [0.08]}, "r"
    )
    config = apply_conditions(EpisodeConfig(explorer="nearest"), recipe.draw(1))
    assert 20.0 <= config.turn_deg <= 60.0
    episode = run_episode(plan, 1, config, make_explorer)
    assert episode.plan.bounds == pytest.approx(plan.turned(config.turn_deg).bounds)
    assert (
        make_pair(episode.plan, episode.start, episode.slam_map, PairConfig()).frame.resolution
        == 0.08
    )


def test_a_recipe_that_is_named_often_is_read_once(monkeypatch):
    read = []
    monkeypatch.setattr(
        "slamgym.dataset.generate.recipe.read_text",
        lambda path, limit: read.append(path) or path.read_text(),
    )
    parse_recipe({"recipe": [{"value": "quick"}] * 300}, "r")
    assert len(read) == 1
