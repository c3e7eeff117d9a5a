"""What a film needs is known before it is made."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.viz import films


def test_a_gif_needs_no_ffmpeg_and_an_mp4_says_so_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr(films.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ConfigError, match=r"an MP4 needs ffmpeg; .*slamgym\[films\].*or write a .gif"
    ):
        films.check_film_name(tmp_path / "film.mp4")
    with films.open_film(tmp_path / "film.gif", 5.0) as show:
        for grey in (0, 255):
            show(np.full((8, 9, 3), grey, np.uint8))
    assert (tmp_path / "film.gif").read_bytes().startswith(b"GIF8")
