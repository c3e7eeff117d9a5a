"""Products and factors of matrices, and exponentials, that are the same to the bit on every x86-64 processor.

BLAS, LAPACK and numpy's vectorised ``exp`` choose their order of summation and their polynomials by the processor. What
an explorer decides with them differs in the last bit, and a few hundred steps later in everything. Here sums are added
in the order of their terms and no multiplication is fused with an addition, so that the same seed gives the same bytes.
``tests/test_portable_arithmetic.py`` holds that what acts calls nothing else.
"""

import math
from typing import Any, TypeVar

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray

_Values = TypeVar("_Values", Float32Array, FloatArray)

_LOWEST = -745.2
"""Of what is less the exponential is 0 ..."""
_HIGHEST = 709.782712893384
"""... and of what is more it is infinite."""
_PER_LN2 = 1.4426950408889634
"""1 / ln 2."""
_LN2_HIGH = 0.6931471803691238
"""ln 2 in so few digits that its multiples are exact ..."""
_LN2_LOW = 1.9082149292705877e-10
"""... and the rest of it."""
_SERIES = tuple(1.0 / math.factorial(term) for term in range(13, -1, -1))
"""Coefficients of the series, the highest power first; the next term is 4e-18 at half of ln 2."""


@kernel
def multiply(a: Any, b: Any, out: Any) -> None:
    """Add a (N, K) times b (K, M) to out (N, M), each sum in the order of K; all C-contiguous and of one type."""
    inner = a.shape[1]
    grouped = inner - inner % 4
    for i in range(a.shape[0]):
        for k in range(0, grouped, 4):
            # Four terms for each access of out, still added one after the other.
            p = a[i, k]
            q = a[i, k + 1]
            r = a[i, k + 2]
            s = a[i, k + 3]
            for j in range(b.shape[1]):
                total = out[i, j] + p * b[k, j]
                total = total + q * b[k + 1, j]
                total = total + r * b[k + 2, j]
                out[i, j] = total + s * b[k + 3, j]
        for k in range(grouped, inner):
            p = a[i, k]
            for j in range(b.shape[1]):
                out[i, j] += p * b[k, j]


@kernel
def _exponentiate(values: FloatArray) -> None:
    """Replace values (N,) by their exponentials: series about the nearest multiple of ln 2."""
    for i in range(len(values)):
        x = values[i]
        if not x > _LOWEST:
            values[i] = 0.0 if x == x else x
        elif x > _HIGHEST:
            values[i] = math.inf
        else:
            k = math.floor(x * _PER_LN2 + 0.5)
            rest = (x - k * _LN2_HIGH) - k * _LN2_LOW
            total = 0.0
            for share in _SERIES:
                total = total * rest + share
            values[i] = math.ldexp(total, int(k))


@kernel
def lower_factor(matrix: FloatArray) -> FloatArray:
    """L (N, N) with L L^T = a symmetric positive definite matrix (Cholesky)."""
    n = len(matrix)
    factor = np.zeros((n, n))
    for row in range(n):
        for col in range(row + 1):
            rest = matrix[row, col]
            for k in range(col):
                rest -= factor[row, k] * factor[col, k]
            factor[row, col] = math.sqrt(rest) if row == col else rest / factor[col, col]
    return factor


@kernel
def solve_upper(factor: FloatArray, values: FloatArray) -> FloatArray:
    """Solution (N,) of L^T x = values."""
    solution = values.copy()
    for row in range(len(factor) - 1, -1, -1):
        for k in range(row + 1, len(factor)):
            solution[row] -= factor[k, row] * solution[k]
        solution[row] /= factor[row, row]
    return solution


@kernel
def solve_factored(factor: FloatArray, values: FloatArray) -> FloatArray:
    """Solution (N,) of L L^T x = values."""
    halfway = values.copy()
    for row in range(len(factor)):
        for k in range(row):
            halfway[row] -= factor[row, k] * halfway[k]
        halfway[row] /= factor[row, row]
    return solve_upper(factor, halfway)


@kernel
def inverted(matrix: FloatArray) -> FloatArray:
    """The inverse (N, N) of a symmetric positive definite matrix."""
    factor = lower_factor(matrix)
    found = np.eye(len(matrix))
    for row in range(len(matrix)):
        found[row] = solve_factored(factor, found[row])
    return found


def product(a: _Values, b: Float32Array | FloatArray) -> _Values:
    """The matrix product of a, shape (N, K), and b, shape (K, M), in the type of a."""
    out = np.zeros((len(a), b.shape[1]), a.dtype)
    multiply(np.ascontiguousarray(a), np.ascontiguousarray(b, a.dtype), out)
    return out


def exp(values: _Values) -> _Values:
    """Exponentials, of any shape, float32 or float64 as given; within 2 units in the last place."""
    found = np.array(values, np.float64)
    _exponentiate(found.reshape(-1))
    return found.astype(values.dtype, copy=False)
