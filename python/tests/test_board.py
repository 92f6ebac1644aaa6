"""What the package can do, in turn at one drive: simulated, or a virtual board."""

import asyncio

import hallservo
import hallservo.aio
import numpy as np
import pytest
from conftest import BOARD


@pytest.fixture
def drive(shared):
    """Calibrated, at rest before and after."""
    with hallservo.connect(shared, patience=600) as drive:
        if not drive.status()["calibrated"]:
            assert len(drive.calibrate()["halls"]) == 3
        yield drive


def armed(drive):
    drive.arm()
    return drive


def test_it_says_who_it_is(drive):
    assert (BOARD or "simulated").split("-")[0] in drive.board.lower()
    assert 0 < drive.get("stall_s") < 10


def test_it_turns_and_goes_where_it_is_told_to(drive):
    armed(drive).telemetry(0.3, speed=40.0)
    frames = drive.telemetry(0.3, hz=500, speed=40.0)
    assert abs(frames["speed_rad_s"].mean() - 40) < 1 and np.all(np.diff(frames["time_s"]) > 0)
    position = drive.status()["position_turns"] + 1
    drive.telemetry(0.8, position=position)
    assert abs(drive.status()["position_turns"] - position) < 0.01


def test_a_step_is_recorded_about_the_command(drive):
    armed(drive).telemetry(0.3, speed=20.0)
    found = drive.record(["speed_ref", "speed", "i_q"], every=40, rows=120, trigger="command", speed=40.0)
    assert list(found) == ["time_s", "speed_ref", "speed", "i_q"]
    assert all(isinstance(column, np.ndarray) and column.shape == (120,) for column in found.values())
    assert np.allclose(np.diff(found["time_s"]), found["time_s"][31]) and found["time_s"][30] == 0.0
    # The command has its way to the interrupt, and the speed reference its acceleration.
    assert np.all(np.abs(found["speed"][:30] - 20) < 4) and np.all(np.abs(found["speed_ref"][:30] - 20) < 0.1)
    assert np.all(np.abs(found["speed_ref"][-30:] - 40) < 0.1)
    assert abs(found["speed"][-30:].mean() - 40) < 2


def test_a_level_is_a_trigger(drive):
    armed(drive).telemetry(0.3, speed=10.0)
    found = drive.record(["speed"], rows=64, every=8, trigger="speed > 20", before=0.5, speed=40.0)
    assert len(found["speed"]) == 64 and found["speed"][31] < 20 <= found["speed"][32]


def test_what_cannot_be_recorded_is_said_in_words(drive):
    for wrong in [
        dict(channels=["torque"]), dict(channels=["i_q", "i_d", "speed", "bus", "angle"]), dict(trigger="i_q>nan"),
        dict(before=1.0), dict(before=float("nan")), dict(seconds=float("nan")), dict(seconds=-1.0),
        dict(speed=1.0, torque=1.0),
    ]:
        with pytest.raises(ValueError):
            drive.record(**wrong)
    for wrong in [dict(every=-1), dict(every=70_000), dict(rows=-1)]:
        with pytest.raises(OverflowError):
            drive.record(**wrong)
    for wrong in [dict(channels=["i_q", "i_q"]), dict(channels=[]), dict(rows=513), dict(rows=0), dict(every=0)]:
        with pytest.raises(hallservo.DriveError):
            drive.record(**wrong)
    with pytest.raises(hallservo.DriveError, match="did not come within 0.2 s"):
        drive.record(trigger="bus>30", seconds=0.2)
    # The scope is free then, and what is recorded at rest is.
    now = drive.record(["bus", "hall_1"], rows=20)
    assert np.all(np.abs(now["bus"] - 24) < 1) and now["time_s"][0] == 0.0
    # A command to a drive whose bridge is off.
    with pytest.raises(hallservo.DriveError):
        drive.record(speed=10.0)
    assert len(drive.record(["bus"], rows=7)["bus"]) == 7


def test_asyncio_records_and_a_stop_ends_it(drive, shared):
    drive.close()

    async def work():
        async with hallservo.aio.connect(shared, patience=600) as drive:
            await drive.arm()
            found = await drive.record(["speed"], every=40, rows=80, trigger="command", speed=30.0)
            assert found["speed"][:20].max() < 5 < found["speed"].max()
            never = asyncio.create_task(drive.record(trigger="bus<5", speed=30.0))
            await asyncio.sleep(0.3)
            await drive.stop()
            with pytest.raises(hallservo.DriveError, match="cancelled"):
                await never
            status = await drive.status()
            assert status["state"] == "ready" and abs(status["speed_rad_s"]) < 5
            # It is free again.
            assert len((await drive.record(["bus"], rows=9))["bus"]) == 9

    asyncio.run(work())
