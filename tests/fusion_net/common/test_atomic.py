"""One writer a folder, for as long as its process lives."""

import multiprocessing
import subprocess
import sys
import time

import pytest

from fusion_net.common.atomic import only_writer

HOLD = """
import sys, time
from pathlib import Path
from fusion_net.common.atomic import only_writer
with only_writer(Path(sys.argv[1]), "busy"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_is_taken_until_its_process_is_killed(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ValueError, match=r"^taken$"), only_writer(tmp_path, "taken"):
            pass
        other.kill()
    with only_writer(tmp_path, "taken"):
        pass


def test_a_child_that_outlives_its_writer_does_not_keep_the_folder(tmp_path):
    with only_writer(tmp_path, "taken"):
        child = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,))
        child.start()
    try:
        with only_writer(tmp_path, "taken"):
            pass
    finally:
        child.kill()
        child.join()
