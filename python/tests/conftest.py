import os
import subprocess

import pytest


@pytest.fixture
def port():
    """Of a simulated drive. No time is that on the wall: the drive's passes as it is asked."""
    simulated = subprocess.Popen(
        [os.environ.get("HALLCTL", "hallctl"), "simulate", "--speed", "fast"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    yield simulated.stdout.readline().split()[-1]
    simulated.kill()
    simulated.wait()
