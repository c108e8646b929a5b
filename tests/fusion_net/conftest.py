"""Two cores for torch, which other programs may take."""

import pytest
import torch

from tests.fixtures.busy_cores import BusyCores


@pytest.fixture
def two_cores(monkeypatch):
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    yield BusyCores(monkeypatch)
    torch.set_num_threads(threads)
