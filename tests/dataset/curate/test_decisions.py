import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.dataset.curate.review import (
    Decision,
    check_decisions,
    combine,
    decisions_document,
    read_decisions,
    store_decisions,
    stored_decisions,
)

KEEP = Decision("a", True, "1")
DROP = Decision("a", False, "1")


def document(*entries, **changes):
    return {"format": "slamgym-decisions", "version": 1, "decisions": list(entries)} | changes


@given(st.dictionaries(st.text(min_size=1), st.tuples(st.booleans(), st.text())))
@settings(max_examples=20)
def test_what_is_stored_comes_back_sorted_by_name(tmp_path_factory, decided):
    folder = tmp_path_factory.mktemp("decisions")
    decisions = [Decision(name, keep, digest) for name, (keep, digest) in decided.items()]
    store_decisions(folder, decisions)
    assert list(stored_decisions(folder).values()) == sorted(decisions, key=lambda d: d.name)


def test_nothing_is_stored_at_first(tmp_path):
    assert stored_decisions(tmp_path) == {}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is not valid JSON"),
        ("[]", "is no file of decisions"),
        (json.dumps(document(format="other")), "is no file of decisions"),
        (json.dumps(document(version=2)), "version 2"),
        (json.dumps(document(decisions={})), "no list 'decisions'"),
        (json.dumps(document("a")), "decision 1 needs a name"),
        (
            json.dumps(document({"name": "a", "decision": "maybe", "sha256": ""})),
            "decision 1 needs",
        ),
        (json.dumps(document({"name": "a", "decision": "keep"})), "decision 1 needs"),
        (json.dumps(document({"name": 3, "decision": "keep", "sha256": ""})), "decision 1 needs"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path, content, words):
    path = tmp_path / "decisions.json"
    path.write_text(content)
    with pytest.raises(InputFileError, match=words) as error:
        read_decisions(path)
    assert str(path) in str(error.value)


def test_a_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.json"):
        read_decisions(tmp_path / "nowhere.json")


def test_a_file_that_contradicts_itself_is_refused(tmp_path):
    path = tmp_path / "decisions.json"
    entry = {"name": "a", "decision": "keep", "sha256": "1"}
    path.write_text(json.dumps(document(entry, entry)))
    assert read_decisions(path) == [KEEP]
    path.write_text(json.dumps(document(entry, {**entry, "decision": "drop"})))
    with pytest.raises(ConfigError, match="conflicting decisions about a"):
        read_decisions(path)


def test_people_who_agree_are_combined_and_those_who_do_not_are_named():
    other = Decision("b", False, "2")
    assert combine([[KEEP], [other], [KEEP]]) == {"a": KEEP, "b": other}
    with pytest.raises(ConfigError, match=r"first and second: conflicting decisions about a;"):
        combine([[KEEP, other], [DROP]], ["first", "second"])


def test_names_that_do_not_exist_are_refused_and_the_first_few_named():
    unexpected = [Decision(f"x{i}", True, "") for i in range(8)]
    with pytest.raises(ConfigError, match=r"no such maps: x0, x1, x2, x3, x4 and 3 more"):
        check_decisions(unexpected, {"a": "1"}, "d.json")


def test_a_decision_about_another_map_of_the_same_name_is_refused():
    check_decisions([KEEP], {"a": "1"}, "d.json")
    with pytest.raises(ConfigError, match="made for other maps of the same names: a"):
        check_decisions([KEEP], {"a": "another"}, "d.json")


def test_the_document_is_what_the_page_saves():
    assert json.loads(decisions_document([DROP])) == document(
        {"name": "a", "decision": "drop", "sha256": "1"}
    )
