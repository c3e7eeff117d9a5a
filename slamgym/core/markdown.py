"""Tables in Markdown."""

from collections.abc import Iterable, Sequence

from slamgym.core.text import printable


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown whose columns line up, the first flush left and the others right, ended by a line break."""
    table = [[printable(cell).replace("|", r"\|") for cell in row] for row in (headings, *rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]

    def line(first: str, *others: str) -> str:
        padded = (cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))
        return "| " + " | ".join([first.ljust(widths[0]), *padded]) + " |\n"

    rule = "|" + "|".join(["-" * (widths[0] + 2), *("-" * (width + 1) + ":" for width in widths[1:])]) + "|\n"
    return line(*headings) + rule + "".join(line(*row) for row in table[1:])
