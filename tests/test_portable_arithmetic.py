"""What simulates, maps and acts calls no arithmetic whose last bit depends on the processor.

BLAS and LAPACK choose their kernels by the processor, numpy some of its functions of arrays by AVX-512. A closed loop
turns a last bit into another exploration, so these modules add in a fixed order (:mod:`slamgym.core.portable`).
"""

import ast
import math

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from source_tree import modules, tree_of

from slamgym.core.portable import exp, inverted, lower_factor, product, solve_factored, solve_upper

ACTING = ("agents", "core", "envs", "planning", "sim", "slam")
APART = {
    "slamgym.agents.rl": "training, in torch",
    "slamgym.core.intervals": "statistics of finished runs",
    "slamgym.slam.merge": "where finished maps lie on each other",
    "slamgym.slam.localization": "where a robot is on a finished map",
}
"""Modules of these packages that are not on the way from a seed to an exploration, and why."""
LINEAR = {
    "dot",
    "vdot",
    "inner",
    "matmul",
    "tensordot",
    "einsum",
    "linalg",
    "lstsq",
    "polyfit",
    "cov",
    "corrcoef",
}
BY_AVX512 = {
    "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "tan", "arctan", "arctan2", "arcsin", "arccos", "sinh",
    "cosh", "tanh", "power", "float_power", "cbrt", "logaddexp",
}  # fmt: skip


def calls_by_processor(module):
    """Places of a module that call what the processor decides, as text."""
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            yield f"{module}:{node.lineno}: @"
        if isinstance(node, ast.Attribute) and node.attr in LINEAR | BY_AVX512:
            of_numpy = isinstance(node.value, ast.Name) and node.value.id == "np"
            if of_numpy or node.attr in {"dot", "linalg"}:
                yield f"{module}:{node.lineno}: {node.attr}"


def test_what_acts_leaves_no_sum_to_the_processor():
    acting = [
        module
        for module in modules()
        if module.split(".")[1:2]
        and module.split(".")[1] in ACTING
        and not module.startswith(tuple(APART))
    ]
    assert len(acting) > 100
    assert [call for module in acting for call in calls_by_processor(module)] == []


def test_the_search_finds_calls():
    found = {call.split(": ")[1] for call in calls_by_processor("slamgym.metrics.trajectory")}
    assert {"einsum", "linalg"} <= found


def in_order(a, b):
    """The product by plain Python, each sum in the order of its terms and rounded after each operation."""
    kind = a.dtype.type
    out = np.zeros((a.shape[0], b.shape[1]), a.dtype)
    for i, j in np.ndindex(out.shape):
        total = kind(0.0)
        for k in range(a.shape[1]):
            total = kind(total + kind(a[i, k] * b[k, j]))
        out[i, j] = total
    return out


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 37, 5), (6, 8, 16), (3, 30, 33), (2, 0, 4)])
def test_products_add_in_the_order_of_the_terms(kind, shape):
    n, inner, m = shape
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(n, inner)).astype(kind), rng.normal(size=(m, inner)).astype(kind).T
    found = product(a, b)
    assert found.dtype == kind
    assert np.array_equal(found, in_order(a, b))
    if n:  # a row by itself is the same as in company
        assert np.array_equal(product(a[:1], b), found[:1])


@given(arrays.arrays(np.float64, 5, elements=st.floats(-750.0, 715.0)))
def test_exponentials_are_those_of_the_series(values):
    for value, found in zip(values.tolist(), exp(values).tolist(), strict=True):
        if not -745.2 < value <= 709.782712893384:
            assert found == (0.0 if value < 0.0 else math.inf)
            continue
        k = math.floor(value * 1.4426950408889634 + 0.5)
        rest, total = (value - k * 0.6931471803691238) - k * 1.9082149292705877e-10, 0.0
        for term in range(13, -1, -1):
            total = total * rest + 1.0 / math.factorial(term)
        assert found == math.ldexp(total, k)
        assert found == pytest.approx(math.exp(value), rel=1e-15, abs=1e-323)


def test_exponentials_keep_shape_and_type():
    found = exp(np.array([[0.0, -math.inf], [math.inf, math.nan]], np.float32))
    assert found.dtype == np.float32
    assert np.array_equal(found, [[1.0, 0.0], [math.inf, math.nan]], equal_nan=True)


@given(arrays.arrays(np.float64, (4, 4), elements=st.floats(-3.0, 3.0)), st.integers(0, 99))
def test_factors_solve(square, seed):
    matrix = square.dot(square.T) + np.eye(4)
    values = np.random.default_rng(seed).normal(size=4)
    factor = lower_factor(matrix)
    assert factor.dot(factor.T) == pytest.approx(matrix, abs=1e-12)
    assert matrix.dot(solve_factored(factor, values)) == pytest.approx(values, abs=1e-10)
    assert factor.T.dot(solve_upper(factor, values)) == pytest.approx(values, abs=1e-10)
    assert inverted(matrix) == pytest.approx(np.linalg.inv(matrix), abs=1e-12)
