"""A drive at a pseudo-terminal, simulated or a virtual board, calibrated."""

import os
import re
import subprocess
import threading
import time

import pytest

HALLCTL = os.environ["HALLCTL"]
ROOT = os.path.join(os.path.dirname(__file__), "..", "..")
# A virtual board, if there is to be one: `cargo virtual BOARD`; with `--bus` at its CAN-FD, else at its serial line.
BOARD = os.environ.get("BOARD")
BUS = bool(BOARD) and "--bus" in BOARD.split()
# Time passes by requests, not by the clock.
FAST = [] if BOARD else ["--speed", "fast"]
VIRTUAL = ["cargo", "virtual", *(BOARD or "").split(), "--serial", "pty", "--wait", "--typed"]
# The time of the drive that each request is worth.
REQUEST_S = 0.002 if BOARD else 0.02


class Simulated:
    """A drive without hardware: with arguments for `hallctl simulate`, or a virtual board."""

    def __init__(self, *arguments):
        self.happened = threading.Event()
        self.process = subprocess.Popen(
            [*(VIRTUAL if BOARD else [HALLCTL, "simulate", "--pty"]), *arguments], cwd=ROOT,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )
        for line in self.process.stdout:
            if port := re.search(r"/dev/\S+", line):
                self.port = port.group()
                # What else it says is not to fill the pipe.
                threading.Thread(target=self._read, daemon=True).start()
                return
        raise RuntimeError("the drive has ended")

    def hallctl(self, *arguments, check=True):
        """Runs the project's own tool, and waits until it has let go of the port."""
        result = subprocess.run(
            [HALLCTL, "--patience", "600", "--port", self.port, *arguments], capture_output=True, text=True, check=False
        )
        assert result.returncode == 0 or not check, result.stdout + result.stderr
        # The process that shares the port among tools stays for two seconds.
        time.sleep(2.5)
        return result

    def _read(self):
        for line in self.process.stdout:
            if line.startswith("happens:"):
                self.happened.set()
        # It has ended: nobody is to wait for it.
        self.happened.set()

    def happen(self, event):
        """Something breaks, or is mended: what a person would type."""
        self.happened.clear()
        self.process.stdin.write(event + "\n")
        self.process.stdin.flush()
        # A board says when it has, so that what follows comes after it.
        assert not BOARD or self.happened.wait(600)

    def end(self):
        self.process.terminate()
        self.process.wait()


@pytest.fixture(scope="module")
def simulated():
    """Calibrated."""
    drive = Simulated(*(["--calibrated"] if BUS else FAST))
    try:
        if not BUS:
            drive.hallctl("calibrate")
        yield drive
    finally:
        drive.end()


@pytest.fixture
def uncalibrated():
    """As it leaves the shop."""
    drive = Simulated(*FAST)
    try:
        yield drive
    finally:
        drive.end()
