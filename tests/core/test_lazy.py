"""A face shows what its source imports for type checkers, and loads it when it is first asked for."""

import sys
import types

import pytest

from pdssjax.core.lazy import lazy_exports

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
