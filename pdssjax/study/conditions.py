"""Parameters that hold in some records only: "friction.f_ss_a@wet" where a record has the condition "wet".

A record that has the condition takes the number of that parameter, every other that of the parameter without one.
"""

from collections.abc import Collection, Iterable, Mapping

import jax.numpy as jnp

from ..core import Truth
from .models import Values

MARK = "@"
"""Between the path of a parameter and the condition under which it holds."""


def split_path(path: str) -> tuple[str, str]:
    """The path of the parameter, and the condition under which it holds; "" where it always does."""
    base, _, condition = path.partition(MARK)
    return base, condition


def paths_in(paths: Iterable[str], conditions: Collection[str]) -> dict[str, str]:
    """Which of the parameters with these `paths` hold in a record made under `conditions`: by path without one."""
    split = {path: split_path(path) for path in paths}
    usual = {base: path for path, (base, condition) in split.items() if not condition}
    return usual | {base: path for path, (base, condition) in split.items() if condition and condition in conditions}


def under_conditions(values: Values, holds: Mapping[str, Truth | bool]) -> Values:
    """The numbers of one record by paths without conditions.

    **Arguments:** for each condition of the `values`, whether it `holds` in the record; a condition that is not
    there does not.
    """
    found = {path: number for path, number in values.items() if MARK not in path}
    for path, number in values.items():
        base, condition = split_path(path)
        if condition in holds:
            found[base] = jnp.where(holds[condition], number, found[base])
    return found
