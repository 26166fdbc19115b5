"""An address of this machine for the stand-ins of each test process: all of their ports are fixed."""

import os

import pytest


@pytest.fixture(scope="session")
def host():
    """127.x.y.z, which no other process of the tests uses."""
    low, high = divmod(os.getpid(), 250)
    return f"127.70.{1 + low % 250}.{1 + high}"
