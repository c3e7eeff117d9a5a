"""Errors that are the user's to fix.

Every one carries a single sentence that names the file or argument, says what is wrong with it, and how to
fix it. The command line prints that sentence alone; library users catch :class:`SlamgymError`.
"""

import contextlib
from collections.abc import Iterator

from slamgym.core.text import printable

LONGEST_MESSAGE = 500
"""Letters of a message, apart from those of a long path."""
LONGEST_END = 150
"""Letters that are kept of the end of a longer one."""


class SlamgymError(Exception):
    """Base class of all errors that a user can fix."""

    def __str__(self) -> str:
        """The sentence in one line of at most :data:`LONGEST_MESSAGE`, whatever a file or its name holds."""
        text = super().__str__()
        if len(text) > 4 * LONGEST_MESSAGE:
            text = text[: 2 * LONGEST_MESSAGE] + text[-2 * LONGEST_MESSAGE :]
        sentence = printable(" ".join(text.splitlines()))
        if len(sentence) <= LONGEST_MESSAGE:
            return sentence
        # The fix stands at the end.
        return f"{sentence[: LONGEST_MESSAGE - LONGEST_END - 5]} ... {sentence[-LONGEST_END:]}"


class InputFileError(SlamgymError):
    """A file from outside can't be used.

    Args:
        path: The file, or ``file:line`` where the line is known.
        reason: What is wrong and how to fix it, without a full stop.
    """

    def __init__(self, path: object, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = str(path)
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), (self.path, self.reason)


class PlanError(InputFileError):
    """A floor plan can't be explored; ``path`` may be a plan id."""


@contextlib.contextmanager
def as_plan_error() -> Iterator[None]:
    """Turn an error of a file's reader in the block, or in the decorated function, into one of the floor plan."""
    try:
        yield
    except PlanError:
        raise
    except InputFileError as error:
        raise PlanError(error.path, error.reason) from error


class ConfigError(SlamgymError):
    """A setting has an unknown name or a value that makes no sense."""


@contextlib.contextmanager
def needing_extra(what: str, extra: str) -> Iterator[None]:
    """Say which extra brings a package that is imported in the block and isn't installed.

    Args:
        what: What needs it.
        extra: The extra of slamgym.

    Raises:
        ConfigError: If it isn't installed.
    """
    try:
        yield
    except ImportError as error:
        sentence = f"{what} needs the package {error.name!r}; install it with: pip install 'slamgym[{extra}]'"
        raise ConfigError(sentence) from error


class ActionError(SlamgymError):
    """An action is not one of the environment's.

    Args:
        action: What was given to ``step``.
        expected: What should have been given, in words.
    """

    def __init__(self, action: object, expected: str) -> None:
        super().__init__(f"step() takes {expected}, not {action!r}")
        self.action = action
        self.expected = expected

    def __reduce__(self) -> tuple[type, tuple[object, str]]:
        return type(self), (self.action, self.expected)
