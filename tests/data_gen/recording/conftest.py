"""Recordings for all tests of faults, the one without faults made once."""

import pytest

from tests.fixtures.faulty_recording import recorded


@pytest.fixture
def make(tmp_path_factory):
    return lambda *faults, **rig: recorded(tmp_path_factory.mktemp("tree"), *faults, **rig)


@pytest.fixture(scope="session")
def clean(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("tree"))
