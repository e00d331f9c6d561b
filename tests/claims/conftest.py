"""What tests of experiments share."""

import pytest


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Output goes to a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PDSSJAX_FIGURES", raising=False)
    return tmp_path
