"""A simulated drive at a pseudo-terminal, calibrated. Its time passes by requests, not by the clock."""

import os
import re
import subprocess
import time

import pytest

HALLCTL = os.environ["HALLCTL"]


class Simulated:
    """The simulated drive and its keyboard."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen(
            [HALLCTL, "simulate", "--pty", "--speed", "fast", *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )
        self.port = re.search(r"/dev/\S+", self.process.stdout.readline()).group()

    def hallctl(self, *arguments, check=True):
        """Runs the project's own tool, and waits until it has let go of the port."""
        result = subprocess.run(
            [HALLCTL, "--port", self.port, *arguments], capture_output=True, text=True, timeout=120, check=False
        )
        assert result.returncode == 0 or not check, result.stdout + result.stderr
        # The process that shares the port among tools stays for two seconds.
        time.sleep(2.5)
        return result

    def happen(self, event):
        """Something breaks, or is mended: what a person would type."""
        self.process.stdin.write(event + "\n")
        self.process.stdin.flush()

    def end(self):
        self.process.terminate()
        self.process.wait()


@pytest.fixture(scope="module")
def simulated():
    """Calibrated."""
    drive = Simulated()
    try:
        drive.hallctl("calibrate")
        yield drive
    finally:
        drive.end()


@pytest.fixture
def uncalibrated():
    """As it leaves the shop."""
    drive = Simulated()
    try:
        yield drive
    finally:
        drive.end()
