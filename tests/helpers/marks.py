"""Marks of cases of a parametrized test."""

import functools

import pytest

slow = functools.partial(pytest.param, marks=pytest.mark.slow)
"""A case that the default tests leave out."""
