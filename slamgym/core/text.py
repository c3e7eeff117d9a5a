"""Texts from outside, made safe for a terminal, a page or a line of a file."""

import html


def printable(text: str) -> str:
    """A text in one line that any terminal, page or file can hold: what can't be seen is written as in Python.

    That is control characters, line ends, marks that turn the direction of writing, and bytes of a file's name
    that are no UTF-8 (halves of surrogate pairs): a name from outside neither steers a terminal nor looks like another.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def markup(text: str) -> str:
    """The same as a part of HTML or XML, between tags or in an attribute."""
    return html.escape(printable(text))
