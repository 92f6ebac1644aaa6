"""A drive in a process of its own: simulated, or with BOARD=… the firmware of a virtual board."""

import os
import re
import subprocess
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
BOARD = os.environ.get("BOARD")
# No time is that on the wall: the drive's passes as it is asked.
VIRTUAL = ["cargo", "virtual", *(BOARD or "").split(), "--serial", "tcp:127.0.0.1:0", "--wait"]
SIMULATED = [os.environ.get("HALLCTL", "hallctl"), "simulate", "--speed", "fast"]


@contextmanager
def drive():
    process = subprocess.Popen(
        VIRTUAL if BOARD else SIMULATED, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        found = next(filter(None, (re.search(r"tcp:\S+", line) for line in process.stdout)))
        # What else it says is not to fill the pipe.
        threading.Thread(target=process.stdout.read, daemon=True).start()
        yield found.group()
    finally:
        process.terminate()
        process.wait()


@pytest.fixture
def port():
    """Of a drive as it leaves the shop."""
    with drive() as found:
        yield found


@pytest.fixture(scope="module")
def shared():
    """Of a drive that the tests of a file have in turn, whatever the one before has left."""
    with drive() as found:
        yield found
