"""What several commands work on: a small data set, a run trained on it, and a Python that is warm."""

import pytest
from hypothesis import settings

from tests.fixtures.typed_commands import DATA_GEN, ENVIRONMENT, TRAIN, run
from tests.fixtures.warm_python import WarmPython

# A test asserts what comes out, not how soon: other programs may have the cores.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(scope="module")
def warm():
    """For commands that refuse or only tell; whatever trains, generates or is interrupted gets a Python of its own."""
    reports = ("statistics", "tracks.write", "compare.write", "ablation.write")
    modules = ("data_gen.generate", "data_gen.pictures.contact_sheet", "fusion_net.fit", "fusion_net.evaluate")
    modules += tuple(f"fusion_net.reports.{name}" for name in reports)
    python = WarmPython(imports=modules, environment=ENVIRONMENT)
    yield python
    python.close()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = tmp_path_factory.mktemp("data") / "tree"
    code, _, error = run([*DATA_GEN, "data.num_scenes=12", f"data.root={root}"], root.parent)
    assert code == 0, error
    return root


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory):
    """A folder with runs/base."""
    folder = tmp_path_factory.mktemp("work")
    code, _, error = run([*TRAIN, f"data.root={data}", "name=base"], folder)
    assert code == 0, error
    return folder
