"""Which values a setting may have: bounds of numbers, and the tests that follow from a field's type."""

import itertools
import math
import numbers
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

from slamgym.core.names import OneLine


class Within(NamedTuple):
    """Which numbers a setting may be, as in ``Annotated[float, Within(gt=0.0, le=0.5)]``.

    Of a tuple they bound each number. Without bounds a number must be finite, and in :class:`Settings` it must be no
    larger in size than :data:`~slamgym.core.config.LARGEST`.
    """

    ge: float = -math.inf
    gt: float = -math.inf
    le: float = math.inf
    lt: float = math.inf
    power_of_two: bool = False
    infinite: bool = False
    """True if infinity is allowed, too."""
    most: float = math.inf
    """The largest size of numbers that have no upper bound."""

    def allow(self, number: float) -> bool:
        """True if the setting may be this number."""
        inside = self.ge <= number <= self.le and self.gt < number < self.lt
        inside = inside and not self.is_too_large(number)
        if self.power_of_two:
            return inside and int(number).bit_count() == 1
        return inside or (self.infinite and number == math.inf)

    def is_too_large(self, number: float) -> bool:
        """True for a number that is larger than a setting without an upper bound may be."""
        has_upper_bound = min(self.le, self.lt) < math.inf
        return not has_upper_bound and self.most < abs(number) < math.inf

    def __str__(self) -> str:
        low = max(self.ge, self.gt)
        high = min(self.le, self.lt)
        if math.isinf(low) and math.isinf(high):
            return "finite"
        if math.isinf(high):
            return f"{'above' if low == self.gt else 'at least'} {low:g}"
        if math.isinf(low):
            return f"{'below' if high == self.lt else 'at most'} {high:g}"
        kind = "a power of two " if self.power_of_two else ""
        opening = "(" if low == self.gt else "["
        closing = ")" if high == self.lt else "]"
        return f"{kind}in {opening}{low:g}, {high:g}{closing}"


class ValueFault(NamedTuple):
    """A fault of a value, or of an inner one of it at a place such as ``[2].x``."""

    must_be: str
    value: Any
    place: str = ""


ValueTest = Callable[[Any], ValueFault | None]


def value_test(hint: Any, rule: Any = None) -> ValueTest:
    """Make the function that finds what is wrong with a value of a type, which a rule may restrict."""
    origin = typing.get_origin(hint)
    options = typing.get_args(hint)
    if origin is Annotated:
        for own in options[1:]:
            if isinstance(own, Within) and rule is not None:
                own = own._replace(most=rule.most)
            if isinstance(own, Within | OneLine):
                return value_test(options[0], own)
        return value_test(options[0], rule)
    if hint in (int, float) or (hint is str and isinstance(rule, OneLine)):
        return _ruled_test(hint, rule or Within())
    if origin in (types.UnionType, typing.Union):
        return _union_test([value_test(option, rule) for option in options])
    if origin in (tuple, list, dict, Mapping) or hasattr(hint, "_fields"):
        return _container_test(hint, rule)
    if origin is typing.Literal:
        return _choice_test(options)
    kind = object if hint is Any else origin or hint
    expected = "None" if hint is types.NoneType else _type_name(hint)
    return lambda value: None if isinstance(value, kind) else ValueFault(expected, value)


def _choice_test(options: Sequence[Any]) -> ValueTest:
    choices = [(type(option), option) for option in options]
    expected = " or ".join(map(repr, options))
    return lambda value: None if (type(value), value) in choices else ValueFault(expected, value)


def _type_name(hint: Any) -> str:
    return f"of type {getattr(hint, '__name__', hint)}"


def _ruled_test(hint: Any, rule: Within | OneLine) -> ValueTest:
    # numpy's scalars are numbers, too
    kinds: dict[Any, Any] = {int: numbers.Integral, float: numbers.Real}
    kind = kinds.get(hint, hint)
    usual = (int, float) if hint is float else (hint,)

    def find_fault(value: Any) -> ValueFault | None:
        if type(value) not in usual and (isinstance(value, bool) or not isinstance(value, kind)):
            return ValueFault(_type_name(hint), value)
        if rule.allow(value):
            return None
        if isinstance(rule, Within) and rule.is_too_large(value):
            return ValueFault(f"at most {rule.most:g} in size", value)
        return ValueFault(str(rule), value)

    return find_fault


def _union_test(tests: Sequence[ValueTest]) -> ValueTest:
    def find_fault(value: Any) -> ValueFault | None:
        faults = [test(value) for test in tests]
        if None in faults:
            return None
        return ValueFault(" or ".join(fault.must_be for fault in faults if fault), value)

    return find_fault


def _container_test(hint: Any, rule: Any) -> ValueTest:
    """The test of a tuple, a named tuple, a list or a mapping and of all that it holds."""
    kind = typing.get_origin(hint) or hint
    names = getattr(hint, "_fields", None)
    options: Any = typing.get_args(hint)
    if names:
        options = typing.get_type_hints(hint, include_extras=True).values()
    tests = [value_test(option, rule) for option in options if option is not Ellipsis]
    is_mapping = kind in (dict, Mapping)
    is_fixed = kind is tuple and Ellipsis not in options
    form = ".{}" if names else "[{!r}]"
    each = tests if names or is_fixed else itertools.repeat(tests[-1])

    def find_fault(value: Any) -> ValueFault | None:
        if not isinstance(value, kind):
            return ValueFault(_type_name(hint), value)
        if is_fixed and len(value) != len(tests):
            return ValueFault(f"{len(tests)} values", value)
        keys = value if is_mapping else names or itertools.count()
        items = value.values() if is_mapping else value
        for key, test, item in zip(keys, each, items, strict=False):
            fault = test(item)
            if fault is not None:
                return fault._replace(place=form.format(key) + fault.place)
        return None

    return find_fault
