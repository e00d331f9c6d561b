"""Results are compared by value, and a face shows what its source imports for type checkers."""

import copy
import dataclasses
import importlib
import pickle
import pkgutil
import sys
import types

import fabricated
import numpy as np
import pytest

import pdssjax
from pdssjax.core import equal_by_value
from pdssjax.core.lazy import lazy_exports


def test_an_estimate_is_equal_to_its_copy_and_to_no_other():
    estimate = fabricated.estimate()
    for again in (copy.deepcopy(estimate), pickle.loads(pickle.dumps(estimate))):
        assert again == estimate
    covariance = estimate.covariance.copy()
    covariance[0, 0] *= 1.0 + 1e-15
    assert dataclasses.replace(estimate, covariance=covariance) != estimate
    assert dataclasses.replace(estimate, title="another") != estimate
    assert estimate != "an estimate"
    parameters = estimate.parameters
    assert copy.deepcopy(fabricated.draws(parameters, "posterior")) == fabricated.draws(parameters, "posterior")


@equal_by_value
@dataclasses.dataclass(frozen=True)
class Some:
    numbers: np.ndarray
    more: dict[str, float] = dataclasses.field(default_factory=dict)


@pytest.mark.parametrize(
    ("other", "equal"),
    [
        (Some(np.array([1.0, np.nan])), True),
        (Some(np.array([1.0, 2.0])), False),
        (Some(np.array([1.0])), False),
        (Some(np.array([1, 2])), False),
        (Some(np.array([1.0, np.nan]), {"a": float("nan")}), False),
    ],
)
def test_numbers_are_compared_one_by_one(other, equal):
    assert (Some(np.array([1.0, np.nan])) == other) is equal
    nothing = Some(np.zeros(0), {"a": float("nan")})
    assert nothing == Some(np.zeros(0), {"a": float("nan")}) and nothing != Some(np.zeros(0), {"a": 1.0})


def with_arrays():
    """Every dataclass of the package with an array among its fields that is compared by the dataclass itself."""
    for found in pkgutil.walk_packages(pdssjax.__path__, "pdssjax."):
        if not found.name.startswith(("pdssjax.explore", "pdssjax.__main__")):
            try:
                module = importlib.import_module(found.name)
            except ModuleNotFoundError as error:
                if str(error.name).startswith("pdssjax"):
                    raise
                continue  # an extra that is not installed
            for kind in vars(module).values():
                if isinstance(kind, type) and dataclasses.is_dataclass(kind) and kind.__module__ == found.name:
                    arrays = [field for field in dataclasses.fields(kind) if "ndarray" in str(field.type)]
                    made = getattr(kind.__eq__, "__code__", None)
                    # What dataclasses make themselves has no file.
                    if arrays and made is not None and made.co_filename == "<string>":
                        yield f"{found.name}.{kind.__name__}"


def test_no_dataclass_with_arrays_compares_them_by_itself():
    assert list(with_arrays()) == []


SOURCE = """
if TYPE_CHECKING:
    from .errors import InputError as InputError
    from .units import (
        factor as factor,
        to_si as to_si,
    )
else:
    from .families import members
"""


@pytest.fixture
def face(monkeypatch):
    """Makes a face of the room `core` that has the given source."""

    def made(source):
        module = types.ModuleType("pdssjax.core")
        module.__loader__ = types.SimpleNamespace(get_source=lambda name: source)
        monkeypatch.setitem(sys.modules, "pdssjax.core", module)
        return module, *lazy_exports("pdssjax.core")

    return made


def test_what_is_imported_for_type_checkers_is_shown_and_nothing_else(face):
    module, get, names, shown = face(SOURCE)
    assert shown == names() == ["InputError", "factor", "to_si"]
    assert not hasattr(module, "to_si")
    assert get("to_si").__module__ == "pdssjax.core.units" and module.to_si is get("to_si")
    with pytest.raises(AttributeError, match="no attribute 'members'"):
        get("members")


def test_a_face_without_source_is_refused(face):
    with pytest.raises(ImportError, match="no source of pdssjax"):
        face(None)
