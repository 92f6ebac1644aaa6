"""A drive that several threads use, and a process that forks; what is wrong is told in words."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import hallservo
import pytest


def connect(port):
    return hallservo.connect(port, patience=60)


def test_requests_of_threads_have_their_turn(port):
    with connect(port) as drive, ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda _: drive.status()["state"], range(40)))
        assert found == ["unarmed"] * 40


def test_another_thread_stops_what_goes_on(port):
    with connect(port) as drive:
        drive.calibrate()
        drive.arm()
        turns = threading.Event()

        def follow():
            turns.set()
            drive.telemetry(1000.0, speed=30.0)

        with ThreadPoolExecutor(1) as thread:
            followed = thread.submit(follow)
            turns.wait()
            while abs(drive.status()["speed_rad_s"]) < 20:
                pass
            drive.stop()
            with pytest.raises(hallservo.DriveError):
                followed.result()
        assert drive.status()["state"] == "ready"


def test_a_process_that_forks_and_ends_stops_no_motor(port):
    with connect(port) as drive:
        drive.calibrate()
        drive.arm()
        child = os.fork()
        if child == 0:
            code = 1
            try:
                drive.status()
            except hallservo.DriveError as why:
                code = 0 if "another process" in str(why) else 2
            drive.close()
            os._exit(code)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert drive.status()["state"] == "running"


def test_what_is_wrong_is_told_in_words(port):
    for patience in [0.0, -1.0, float("nan"), float("inf"), 1e30]:
        with pytest.raises(ValueError, match="a number of seconds above 0"):
            hallservo.connect(port, patience)
    with connect(port) as drive:
        with pytest.raises(hallservo.DriveError, match="there is no fault to clear"):
            drive.clear()
        # As many rows as the drive has room for.
        assert len(drive.record(["bus"])["bus"]) in (128, 512)
