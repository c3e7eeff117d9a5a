import imageio
import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plans") / "flat.json"
    write_houseexpo(path, FloorPlan("flat", box(0, 0, 3.0, 2.4)))
    return path


def watch(plan, *more):
    return cli.main(
        ["watch", "--plans", str(plan), "--minutes", "0.1", "--set", "particles=3", *more]
    )


# imageio's own reader of films leaves its pipe to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_has_the_frames_that_speed_and_rate_ask_for(plan, tmp_path, capsys, name):
    path = tmp_path / name
    # 6 s of robot time are 31 states; at 8 times the speed and 10 frames a second every 4th is shown.
    assert watch(plan, "-o", str(path), "--speed", "8", "--fps", "10") == 0
    shown = capsys.readouterr()
    assert shown.out == f"{path}\n"
    assert "covered" in shown.err
    with imageio.get_reader(path) as film:
        frames = [frame.shape for frame in film]
    assert len(frames) == 8 + 1  # and the last state
    assert len({*frames}) == 1
    assert [p.name for p in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["-o", "film.avi"], "must end in .mp4 or .gif"),
        (["--rerun", "run.mp4"], "must end in .rrd"),
        (["--speed", "0", "-o", "film.gif"], "--speed must be in (0, 1000), not 0.0"),
        (["--plan", "flatt", "-o", "film.gif"], "did you mean 'flat'"),
        (["--explorer", "nearst", "-o", "film.gif"], "did you mean 'nearest'"),
    ],
)
def test_mistakes_are_one_line_and_leave_no_file(plan, tmp_path, monkeypatch, capsys, more, words):
    monkeypatch.chdir(tmp_path)
    assert watch(plan, *more) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
