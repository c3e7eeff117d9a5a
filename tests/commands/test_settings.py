"""How the settings of a command are given: a file, --set, options."""

import json

import pytest

from slamgym.agents.evaluation.evaluate import EvaluationConfig
from slamgym.commands import cli
from slamgym.commands.settings import CLEARED, SettingsOptions
from slamgym.core.errors import SlamgymError
from slamgym.dataset.generate.recipe import DatasetConfig
from slamgym.sim import odometry_level

SENTENCES = {
    "another name": ("episode.minuts=2", "did you mean 'episode.minutes'?"),
    "another end": ("lidar.range_mx=2", "did you mean 'lidar.range_max'?"),
    "several": ("noise=2", "unknown setting 'noise'"),
    "out of range": ("particles=0", "particles must be in [1, 10000], not 0"),
    "another type": ("particles=many", "particles must be of type int"),
    "no value": ("particles", "takes NAME=VALUE"),
    "a level": ("odometry=huge", "'huge'"),
    "a section": ("slam=pose_graph", "is a section"),
}
FILES = {
    "another name": ({"episode": {"minuts": 2}}, "unknown setting 'minuts' of EpisodeConfig; did you mean 'minutes'?"),
    "out of range": ({"episode": {"env": {"slam": {"particles": 0}}}}, "particles must be in [1, 10000], not 0"),
    "another version": ({"version": "99.0", "sid": 3}, "slamgym '99.0' wrote it"),
    "code": ({"episode": {"explorer": "my_module:run"}}, "code of your own"),
    "a list": ([1], "holds no settings"),
}  # fmt: skip


def test_a_file_is_overruled_by_set_and_both_by_options(tmp_path):
    path = tmp_path / "settings.json"
    first = SettingsOptions(set=(("slam.particles=5", "seed=4"), ("minutes=2",)), save_config=path)
    first.configured(DatasetConfig(), {})
    again = SettingsOptions(config=path, set=(("seed=8", "lidar.range_max=5", "odometry=high"),))
    found = again.configured(DatasetConfig(), {"episode.minutes": 3.0, "trajectories": None})
    env = found.episode.env
    assert (found.seed, found.episode.minutes, found.trajectories) == (8, 3.0, 1)
    assert (env.slam.particles, env.lidar.range_max, env.odometry) == (
        5,
        5.0,
        odometry_level("high"),
    )
    assert isinstance(env.lidar.range_max, float)


def test_a_setting_can_be_cleared_and_a_partial_file_keeps_the_rest(tmp_path):
    path = tmp_path / "settings.json"
    path.write_text(json.dumps({"config": {"count": 3}, "summary": {}}))
    found = SettingsOptions(config=path).configured(
        EvaluationConfig(("nearest",)), {"trial.promise": CLEARED}
    )
    assert (found.explorers, found.count, found.trial.promise) == (("nearest",), 3, None)


@pytest.mark.parametrize("case", SENTENCES)
def test_a_wrong_setting_is_one_sentence(case):
    setting, words = SENTENCES[case]
    with pytest.raises(SlamgymError) as error:
        SettingsOptions(set=((setting,),)).configured(DatasetConfig(), {})
    assert words in str(error.value)


@pytest.mark.parametrize("case", FILES)
def test_a_wrong_file_is_one_sentence_that_names_it(case, tmp_path, capsys):
    content, words = FILES[case]
    path = tmp_path / "settings.json"
    path.write_text(json.dumps(content))
    assert cli.main(["generate", "-o", str(tmp_path / "out"), "--config", str(path)]) == 2
    said = capsys.readouterr().err
    assert str(path) in said
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
