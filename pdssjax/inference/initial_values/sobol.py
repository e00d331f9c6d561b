"""Points that fill a unit cube evenly, whatever their number: Sobol's sequence, shifted.

Direction numbers of S. Joe and F. Y. Kuo, SIAM J. Scientific Computing 30(5), 2008, for the first dimensions; the
shift modulo one is that of R. Cranley and T. N. L. Patterson, SIAM J. Numerical Analysis 13(6), 1976.
"""

import numpy as np
from jaxtyping import Float

_BITS = 30

# Of each dimension after the first: degree and inner coefficients of its polynomial, and its first odd numbers.
_DIRECTIONS = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
    (5, 4, (1, 1, 5, 5, 5)),
    (5, 7, (1, 1, 7, 11, 19)),
    (5, 11, (1, 1, 5, 1, 1)),
    (5, 13, (1, 1, 1, 3, 11)),
    (5, 14, (1, 3, 5, 5, 31)),
    (6, 1, (1, 3, 3, 9, 7, 49)),
    (6, 13, (1, 1, 1, 15, 21, 21)),
    (6, 16, (1, 3, 1, 13, 27, 49)),
    (6, 19, (1, 1, 1, 15, 7, 5)),
    (6, 22, (1, 3, 1, 15, 13, 25)),
    (6, 25, (1, 1, 5, 5, 19, 61)),
    (7, 1, (1, 3, 7, 11, 23, 15, 103)),
    (7, 4, (1, 3, 7, 13, 13, 15, 69)),
)

DIMENSIONS = 1 + len(_DIRECTIONS)


def sobol_points(count: int, dimensions: int, seed: int) -> Float[np.ndarray, "count dimensions"]:
    """The first `count` points, shifted by random numbers of the `seed`, in [0, 1).

    Dimensions beyond the table are strata in random order: a Latin hypercube.
    """
    random = np.random.default_rng(seed)
    columns = [_column(count, dimension) for dimension in range(min(dimensions, DIMENSIONS))]
    columns += [random.permutation(count) / count for _ in range(dimensions - len(columns))]
    return np.mod(np.stack(columns, axis=1) + random.random(dimensions), 1.0)


def _column(count: int, dimension: int) -> Float[np.ndarray, " count"]:
    """One coordinate of the first points, in the order of the Gray code."""
    directions, numbers = _directions(dimension), np.zeros(count, np.int64)
    for index in range(1, count):
        lowest_zero = (~(index - 1) & index).bit_length() - 1
        numbers[index] = numbers[index - 1] ^ directions[lowest_zero]
    return numbers / 2.0**_BITS


def _directions(dimension: int) -> list[int]:
    if dimension == 0:
        return [1 << (_BITS - 1 - bit) for bit in range(_BITS)]
    degree, inner, first = _DIRECTIONS[dimension - 1]
    found = [odd << (_BITS - 1 - bit) for bit, odd in enumerate(first)]
    for bit in range(degree, _BITS):
        number = found[bit - degree] ^ (found[bit - degree] >> degree)
        for k in range(1, degree):
            if (inner >> (degree - 1 - k)) & 1:
                number ^= found[bit - k]
        found.append(number)
    return found
