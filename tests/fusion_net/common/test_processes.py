"""Ctrl-C while the processes of a run start each other."""

import os
import signal
import subprocess
import sys

import pytest

from fusion_net.common.cli.processes import interrupts_held, release_interrupts

FOLLOWER = (
    "import time; from fusion_net.common.cli.processes import leave_interrupts_to_the_first as leave;"
    " leave(); print('ready', flush=True); time.sleep(0.2); print('went on')"
)


def test_a_process_survives_ctrl_c_in_its_first_moment_and_later():
    with interrupts_held():
        follower = subprocess.Popen([sys.executable, "-c", FOLLOWER], stdout=subprocess.PIPE, text=True)
        follower.send_signal(signal.SIGINT)  # before its interpreter is there
    assert follower.stdout.readline() == "ready\n"
    follower.send_signal(signal.SIGINT)
    assert follower.communicate(timeout=60)[0] == "went on\n"
    assert follower.returncode == 0


def test_ctrl_c_waits_for_the_release():
    with interrupts_held():
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            release_interrupts()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_interrupts_that_nobody_holds_are_not_touched():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupts_held():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
