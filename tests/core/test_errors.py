"""A message is one sentence of a size that fits on a screen."""

from slamgym.core.errors import LONGEST_MESSAGE, InputFileError, SlamgymError


def test_a_long_message_keeps_its_file_and_its_fix():
    error = InputFileError("map.yaml", f"has the image {'x' * 100_000}; give the name of a picture")
    sentence = str(error)
    assert len(sentence) == LONGEST_MESSAGE
    assert sentence.startswith("map.yaml: has the image xxx")
    assert " ... " in sentence
    assert sentence.endswith("; give the name of a picture")


def test_a_message_of_usual_length_stays_whole():
    for length in (1, LONGEST_MESSAGE):
        assert str(SlamgymError("y" * length)) == "y" * length
