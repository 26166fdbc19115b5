"""Models that tests prepare are kept for the session, out of the user's own cache."""

import pytest


@pytest.fixture(autouse=True)
def model_cache(tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.getbasetemp() / "models"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
