"""The review page: parsed, and driven in a real browser where there is one."""

import base64
import json
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from browser import needs_browser, run_in_page

from slamgym.commands import cli
from slamgym.core.types import GridFrame, OccupancyGrid
from slamgym.dataset.curate.map_items import MapItem
from slamgym.dataset.curate.review import Decision, choose_entries, make_review_page, read_decisions
from slamgym.dataset.curate.verdicts import Verdict, read_verdicts
from slamgym.interop import write_ros_map

BAND = (0.4, 0.8)


def cells(seed=0):
    rng = np.random.default_rng(seed)
    picture = np.full((60, 90), 205, np.uint8)
    picture[10:50, 10:80] = rng.choice(
        np.array([0, 205, 254], np.uint8), (40, 70), p=[0.1, 0.1, 0.8]
    )
    return picture


def entry(name, *, probability=0.5, with_cad=True, **changes):
    picture = cells(len(name))
    grid = OccupancyGrid(picture, GridFrame(0.05, 0.0, 0.0, *picture.shape))
    cad = np.where(picture == 254, 254, 0).astype(np.uint8)
    item = MapItem(
        name, lambda: grid, (lambda: cad) if with_cad else None, None, f"digest of {name}"
    )
    values = {
        "name": name, "keep": False, "reason": "doubtful: probability", "by": "classifier",
        "probability": probability, "is_doubtful": BAND[0] <= probability < BAND[1],
        "is_complete": None, "coverage": None, "ate": None, "map_error": None, "faults": (),
    } | changes  # fmt: skip
    return item, Verdict(**values)


def page_of(*entries, decisions=None, title="Review of <flats> & more"):
    return make_review_page(
        title, "slamgym dataset clean d --apply decisions.json", entries, BAND, decisions or {}
    )


class Page(HTMLParser):
    """Tags with their attributes, and the text of each script, style and title."""

    VOID = frozenset({"meta", "img", "link", "br", "input"})

    def __init__(self, text):
        super().__init__()
        self.tags = []
        self.texts = {}
        self.open = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("script", "style", "title"):
            self.texts.setdefault(self.open[-1], []).append(data)

    def data(self):
        return json.loads(self.texts["script"][0])


def test_every_tag_is_closed_and_every_id_unique():
    page = Page(page_of(entry("a"), entry("b")))
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert "".join(page.texts["title"]) == "Review of <flats> & more"


def test_the_page_needs_nothing_but_itself():
    text = page_of(entry("a"), entry("b"))
    page = Page(text)
    for tag, attributes in page.tags:
        for name in ("src", "href", "action", "data", "poster", "srcset"):
            assert attributes.get(name, "data:").startswith(("data:", "#")), (tag, attributes)
        assert not any(name.startswith("on") for name in attributes), "no handlers in attributes"
    assert not re.search(r"https?:|//cdn|@import|url\(|fetch\(|XMLHttpRequest|importScripts", text)
    policies = [a["content"] for t, a in page.tags if t == "meta" and a.get("http-equiv")]
    assert len(policies) == 1
    assert policies[0].startswith("default-src 'none'")


def test_the_script_touches_only_what_the_page_has():
    text = page_of(entry("a"))
    page = Page(text)
    ids = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    used = set(re.findall(r'byId\("([\w-]+)"\)', page.texts["script"][-1]))
    assert used
    assert used <= ids
    for key in ("k", "d", "u", "n", "s", '"?"', "arrowleft", "arrowright"):
        assert re.search(rf"(^|[\s,{{]){re.escape(key)}[:,]", page.texts["script"][-1]), key


def test_every_button_and_picture_has_a_name():
    page = Page(page_of(entry("a")))
    assert dict(page.tags)["html"]["lang"] == "en"
    for tag, attributes in page.tags:
        if tag == "img":
            assert "alt" in attributes
        if tag == "button":
            assert attributes["type"] == "button"
    assert any(attributes.get("aria-live") == "polite" for _, attributes in page.tags)


def test_the_data_hold_the_maps_pixel_by_pixel():
    known = {"b": Decision("b", False, "digest of b")}
    data = Page(
        page_of(entry("a", probability=0.61), entry("b", with_cad=False), decisions=known)
    ).data()
    assert [one["name"] for one in data["maps"]] == ["a", "b"]
    assert [one["decision"] for one in data["maps"]] == [None, "drop"]
    first, second = data["maps"]
    assert (first["probability"], first["sha256"]) == (0.61, "digest of a")
    assert second["cad"] is None
    for side, expected in (("slam", cells(1)), ("cad", np.where(cells(1) == 254, 254, 0))):
        picture = cv2.imdecode(
            np.frombuffer(base64.b64decode(first[side]), np.uint8), cv2.IMREAD_UNCHANGED
        )
        assert picture.shape == (first["height"], first["width"])
        # A border of 8 cells is left of the unknown margin of 10.
        assert (picture == expected[2:58, 2:88]).all()
    assert data["band"] == list(BAND)


def test_names_cannot_break_out_of_the_page():
    wicked = '</script><img src=x onerror=alert(1)>{{SCRIPT}}"'
    text = page_of(entry(wicked), title="{{DATA}} <b>")
    page = Page(text)
    assert page.data()["maps"][0]["name"] == wicked
    assert not any("onerror" in attributes for _, attributes in page.tags)
    assert page.open == []
    assert page.data()["title"] == "{{DATA}} <b>"


def test_another_choice_of_maps_has_another_memory():
    one = Page(page_of(entry("a"))).data()
    two = Page(page_of(entry("a"), entry("b"))).data()
    assert one["digest"] != two["digest"]
    assert page_of(entry("a")) == page_of(entry("a"))


def test_the_maps_are_chosen_by_what_cleaning_said():
    entries = [
        entry("doubtful"),
        entry("kept", probability=0.9, keep=True, is_complete=True),
        entry("wrongly dropped", probability=0.1, is_complete=True),
        entry("wrongly kept", probability=0.9, is_complete=False),
        entry("broken", by="file", probability=0.0),
    ]
    items = [item for item, _ in entries]
    verdicts = {verdict.name: verdict for _, verdict in entries}

    def names(which):
        return [item.name for item, _ in choose_entries(items, verdicts, which)]

    assert names("doubtful") == ["doubtful"]
    assert names("disagreements") == ["wrongly dropped", "wrongly kept"]
    assert names("kept") == ["kept"]
    assert names("dropped") == ["doubtful", "wrongly dropped", "wrongly kept"]
    assert names("all") == ["doubtful", "kept", "wrongly dropped", "wrongly kept"]
    del verdicts["kept"]
    assert "kept" not in names("all")


@pytest.fixture
def maps(tmp_path):
    """A folder of maps from elsewhere that was cleaned."""
    folder = tmp_path / "maps"
    folder.mkdir()
    for number in range(3):
        write_ros_map(
            folder / f"m{number}", OccupancyGrid(cells(number), GridFrame(0.05, 0.0, 0.0, 60, 90))
        )
    assert cli.main(["dataset", "clean", str(folder)]) == 0
    return folder


def test_the_command_writes_the_page(maps, tmp_path, capsys):
    out = tmp_path / "review.html"
    assert cli.main(["dataset", "review", str(maps), "-o", str(out), "--which", "all"]) == 0
    captured = capsys.readouterr()
    assert f"{out}: 3 maps" in captured.out
    assert [one["name"] for one in Page(out.read_text()).data()["maps"]] == ["m0", "m1", "m2"]


def test_with_nothing_to_review_no_page_is_written(maps, tmp_path, capsys):
    out = tmp_path / "review.html"
    verdicts = read_verdicts(maps)
    which = "kept" if not any(verdict.keep for verdict in verdicts.values()) else "dropped"
    assert cli.main(["dataset", "review", str(maps), "-o", str(out), "--which", which]) == 0
    assert "nothing to review" in capsys.readouterr().out
    assert not out.exists()


def test_a_folder_that_was_not_cleaned_is_refused(tmp_path, maps, capsys):
    (maps / "clean.jsonl").unlink()
    assert cli.main(["dataset", "review", str(maps), "-o", str(tmp_path / "r.html")]) == 2
    assert "slamgym dataset clean" in capsys.readouterr().err


DRIVER = """
  const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
  const text = (id) => document.getElementById(id).textContent;
  const read = () => ["progress-text", "place", "state"].map(text).join("; ");
  const seen = [read()];
  let saved = null;
  const RealBlob = Blob;
  window.Blob = function (parts, options) { saved = parts.join(""); return new RealBlob(parts, options); };
  for (const key of ["k", "d", "u", "D", "ArrowLeft", "Home", "?", "k", "?", "n", "s"]) {
    press(key);
    seen.push(read());
  }
  const canvas = document.getElementById("overlay");
  const isPainted = () => canvas.width > 1
    && canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value > 0);
  // Pictures are decoded in real time while the browser's virtual time flies: look often.
  for (let tries = 0; tries < 700 && !isPainted(); tries++) await new Promise((resolve) => setTimeout(resolve, 20));
  return { seen, saved, painted: isPainted(), stored: Object.keys(localStorage).length > 0 };
"""


@needs_browser
def test_keys_decide_and_the_saved_file_is_read_back(tmp_path):
    """Load the page from a file in headless Chromium, press its keys, take what it saves."""
    result = run_in_page(page_of(entry("a"), entry("bb"), entry("ccc")), DRIVER, tmp_path)
    assert result["seen"] == [
        "0 of 3 decided; 1 of 3; not decided",
        "1 of 3 decided; 2 of 3; not decided",  # k
        "2 of 3 decided; 3 of 3; not decided",  # d
        "1 of 3 decided; 2 of 3; not decided",  # u
        "2 of 3 decided; 3 of 3; not decided",  # D, with the caps lock on
        "2 of 3 decided; 2 of 3; dropped",  # left
        "2 of 3 decided; 1 of 3; kept",  # Home
        "2 of 3 decided; 1 of 3; kept",  # ? opens the help
        "2 of 3 decided; 1 of 3; kept",  # which takes no decision
        "2 of 3 decided; 1 of 3; kept",  # ? closes it
        "2 of 3 decided; 3 of 3; not decided",  # n
        "2 of 3 decided; 3 of 3; not decided",  # s
    ]
    assert result["painted"]
    assert result["stored"]
    saved = tmp_path / "decisions.json"
    saved.write_text(result["saved"])
    assert read_decisions(saved) == [
        Decision("a", True, "digest of a"),
        Decision("bb", False, "digest of bb"),
    ]
