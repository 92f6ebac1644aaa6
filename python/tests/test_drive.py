"""At a simulated drive."""

import hallservo
import numpy as np
import pytest


def connect(port):
    return hallservo.connect(port, patience=60)


def test_a_motor_is_calibrated_and_turns(port):
    with connect(port) as drive:
        assert drive.board == "simulated"
        with pytest.raises(hallservo.DriveError, match="no calibration"):
            drive.arm()
        report = drive.calibrate()
        assert len(report["halls"]) == 3 and abs(report["halls"][0]["placement_error_deg"]) < 20
        drive.arm()
        drive.telemetry(0.3, speed=40.0)
        frames = drive.telemetry(0.5, hz=500, speed=40.0)
        assert all(isinstance(column, np.ndarray) and column.dtype == np.float64 for column in frames.values())
        assert len({len(column) for column in frames.values()}) == 1
        assert 200 <= len(frames["time_s"]) <= 350
        assert np.all(np.diff(frames["time_s"]) > 0)
        assert abs(frames["speed_rad_s"].mean() - 40) < 0.5
        position = drive.status()["position_turns"] + 2
        drive.telemetry(1.0, position=position)
        assert abs(drive.status()["position_turns"] - position) < 0.01


def test_telemetry_has_nothing_of_one_that_came_to_nothing(port):
    with connect(port) as drive:
        with pytest.raises(hallservo.DriveError, match="the bridge is off"):
            drive.telemetry(0.3, hz=500, speed=40.0)
        frames = drive.telemetry(0.3, hz=50)
        assert len(frames["time_s"]) > 5 and np.all(np.diff(frames["time_s"]) > 0.015), frames["time_s"]
        with pytest.raises(ValueError, match="frames a second"):
            drive.telemetry(0.1, hz=0)


def test_the_motor_rests_when_the_block_ends(port):
    with pytest.raises(ZeroDivisionError):
        with connect(port) as drive:
            drive.calibrate()
            drive.arm()
            drive.telemetry(0.5, speed=50.0)
            _ = 1 / 0
    with connect(port) as drive:
        status = drive.status()
        assert status["state"] == "ready" and status["limits"] == [] and status["fault"] is None
        assert abs(status["speed_rad_s"]) < 5


def test_settings(port):
    with connect(port) as drive:
        assert drive.set("stall_s", 0.5) == 0.5
        assert drive.get("stall_s") == 0.5
        assert drive.settings()["stall_s"] == 0.5
        assert drive.save()
        with pytest.raises(hallservo.DriveError, match="from 0.01 to 5"):
            drive.set("stall_s", 99)


def test_what_is_wrong_is_said(port):
    with pytest.raises(hallservo.DriveError, match="plugged in"):
        hallservo.connect("/dev/no-such-port")
    for patience in (float("nan"), -1.0):
        with pytest.raises(ValueError):
            hallservo.connect(port, patience=patience)
    drive = connect(port)
    for seconds in (float("nan"), -1.0, 1e99):
        with pytest.raises(ValueError):
            drive.telemetry(seconds)
    with pytest.raises(ValueError):
        drive.telemetry(1.0, speed=1.0, torque=1.0)
    with pytest.raises(hallservo.DriveError):
        drive.telemetry(1.0, hz=1e9)
    drive.close()
    with pytest.raises(hallservo.DriveError, match="closed"):
        drive.status()
