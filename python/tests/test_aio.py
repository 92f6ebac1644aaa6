"""The client for asyncio, at a simulated drive."""

import asyncio
import inspect

import hallservo
import hallservo.aio
import pytest


def at(port, work):
    async def run():
        async with hallservo.aio.connect(port, patience=60) as drive:
            return await work(drive)

    return asyncio.run(run())


def resting(port):
    with hallservo.connect(port, patience=60) as drive:
        status = drive.status()
    assert status["state"] in ("ready", "unarmed") and abs(status["speed_rad_s"]) < 5
    return status


def test_a_motor_turns_while_other_tasks_go_on(port):
    async def work(drive):
        assert await drive.board() == "simulated"
        with pytest.raises(hallservo.DriveError, match="no calibration"):
            await drive.arm()
        ticks = 0

        async def tick():
            nonlocal ticks
            while True:
                await asyncio.sleep(0)
                ticks += 1

        ticking = asyncio.create_task(tick())
        await drive.calibrate()
        ticking.cancel()
        assert ticks > 100
        await drive.arm()
        await drive.telemetry(0.3, speed=40.0)
        # One after the other, in the order in which they were asked.
        frames, status = await asyncio.gather(drive.telemetry(0.3, hz=500, speed=40.0), drive.status())
        assert abs(frames["speed_rad_s"].mean() - 40) < 0.5
        assert status["state"] == "running"

    at(port, work)
    resting(port)


def test_a_task_that_is_cancelled_stops_the_motor(port):
    async def work(drive):
        await drive.calibrate()
        await drive.arm()
        await drive.telemetry(0.3, speed=40.0)
        turning = asyncio.create_task(drive.telemetry(1e5, speed=40.0))
        waiting = asyncio.create_task(drive.status())
        await asyncio.sleep(0.2)
        # What has not begun ends without a trace.
        waiting.cancel()
        await asyncio.sleep(0)
        assert not turning.done()
        turning.cancel()
        with pytest.raises(asyncio.CancelledError):
            await turning
        status = await drive.status()
        assert status["state"] == "ready" and abs(status["speed_rad_s"]) < 5

    at(port, work)


def test_stop_ends_what_goes_on(port):
    async def work(drive):
        await drive.calibrate()
        await drive.arm()
        # Longer than any machine takes for it: what ends by itself may have ended before the stop comes.
        turning = asyncio.create_task(drive.telemetry(1e5, speed=40.0))
        await asyncio.sleep(0.05)
        await drive.stop()
        with pytest.raises(hallservo.DriveError):
            await turning
        status = await drive.status()
        assert status["state"] == "ready" and abs(status["speed_rad_s"]) < 5
        # It can be used again.
        await drive.arm()
        assert (await drive.status())["state"] == "running"

    at(port, work)


def test_the_motor_rests_when_the_block_ends(port):
    async def work(drive):
        await drive.calibrate()
        await drive.arm()
        await drive.telemetry(0.3, speed=50.0)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        at(port, work)
    assert resting(port)["calibrated"]


def test_what_is_wrong_is_said(port):
    async def none():
        async with hallservo.aio.connect("/dev/no-such-port"):
            pass

    with pytest.raises(hallservo.DriveError, match="plugged in"):
        asyncio.run(none())

    async def work(drive):
        with pytest.raises(ValueError):
            await drive.telemetry(float("nan"))
        await drive.close()
        for call in (drive.status, drive.stop):
            with pytest.raises(hallservo.DriveError, match="closed"):
                await call()
        await drive.close()

    at(port, work)


def test_it_can_do_what_the_other_can():
    def methods(kind):
        return {name for name, member in inspect.getmembers(kind) if callable(member) and not name.startswith("_")}

    # The board is a property there.
    assert methods(hallservo.aio.Drive) == methods(hallservo.Drive) | {"board"}
