"""What users of the Python client do."""

import asyncio
import math

import moteus
from conftest import BOARD, REQUEST_S
from moteus import Mode, Register

NAN = math.nan
# As much as a frame has room for.
QUERY = moteus.QueryResolution()
QUERY.q_current = QUERY.d_current = QUERY.power = QUERY.motor_temperature = moteus.F32
QUERY.trajectory_complete = QUERY.home_state = moteus.INT8
QUERY.voltage = QUERY.temperature = moteus.F32


def run(drive, test):
    """Runs a test with a client of its own, which stops the drive before and after."""

    async def whole():
        # A machine that is busy is no reason to ask again.
        transport = moteus.Fdcanusb(drive.port, command_timeout=30, response_timeout=30)
        client = moteus.Controller(id=1, transport=transport, query_resolution=QUERY)
        try:
            await client.set_stop()
            await wait(client, 0.05)
            await test(client)
            await client.set_stop()
        finally:
            transport.close()

    asyncio.run(asyncio.wait_for(whole(), 600))


async def hold(client, seconds, **command):
    """Commands a position again and again, as a controller does; the last answer."""
    result = None
    for _ in range(max(1, round(seconds / REQUEST_S))):
        result = await client.set_position(query=True, **command)
    return result.values


async def wait(client, seconds):
    """Lets time pass; the last answer."""
    result = None
    for _ in range(max(1, round(seconds / REQUEST_S))):
        result = await client.query()
    return result.values


async def control_of(client):
    """What is followed, and the errors."""
    registers = range(Register.CONTROL_POSITION, Register.TORQUE_ERROR + 1)
    return (await client.custom_query({int(register): moteus.F32 for register in registers})).values


async def until(client, condition, **command):
    """The same until something holds."""
    for _ in range(500):
        values = await hold(client, 0.02, **command)
        if condition(values):
            return values
    raise AssertionError(f"never: {values}")


def test_query(simulated):
    async def test(client):
        values = (await client.query()).values
        assert values[Register.MODE] == Mode.STOPPED and values[Register.FAULT] == 0
        assert abs(values[Register.VOLTAGE] - 24) < 0.5 and abs(values[Register.TEMPERATURE] - 25) < 1
        assert values[Register.TORQUE] == 0 and abs(values[Register.VELOCITY]) < 0.5
        # All registers that the client knows are answered, by a value or by an error; at a board some of them, as each
        # takes its time.
        for register in [*range(0x80), *range(0x100, 0x160)][:: 9 if BOARD else 1]:
            command = client.make_custom_query({register: moteus.INT32})
            command.reply_filter = None
            assert await client.execute(command) is not None, hex(register)

    run(simulated, test)


def test_discovery(simulated):
    async def test(client):
        transport = client.transport
        found = await moteus.Transport([transport._transport.devices()[0]]).discover()
        assert [device.can_id for device in found] == [1]

    run(simulated, test)


def test_position(simulated):
    async def test(client):
        start = (await client.query()).values[Register.POSITION]
        for distance in [1.25, -0.5]:
            target = start + distance
            result = await asyncio.wait_for(client.set_position_wait_complete(position=target), 300)
            assert result.values[Register.MODE] == Mode.POSITION
            values = await hold(client, 0.5, position=target)
            assert abs(values[Register.POSITION] - target) < 0.01, values
            control = (await control_of(client))[Register.CONTROL_POSITION]
            assert abs(control - target) < 0.001, control

    run(simulated, test)


def test_limits(simulated):
    """A velocity limit makes the way take its time; the reference is where it is to be."""

    async def test(client):
        start = (await hold(client, 0.5, position=NAN))[Register.POSITION]
        fastest = 0.0
        command = dict(position=start + 1.0, velocity_limit=2.0, accel_limit=20.0)
        for _ in range(25):
            values = await hold(client, 0.02, **command)
            fastest = max(fastest, (await control_of(client))[Register.CONTROL_VELOCITY])
        assert 1.5 < fastest < 2.05, fastest
        await until(client, lambda values: values[Register.TRAJECTORY_COMPLETE], **command)
        values = await hold(client, 0.5, **command)
        assert abs(values[Register.POSITION] - start - 1.0) < 0.02, values

    run(simulated, test)


def test_stop_position(simulated):
    async def test(client):
        start = (await hold(client, 0.5, position=NAN))[Register.POSITION]
        command = dict(position=NAN, velocity=3.0, stop_position=start + 1.5)
        values = await until(client, lambda values: values[Register.POSITION] > start + 0.5, **command)
        values = await hold(client, 1.5, **command)
        assert abs(values[Register.POSITION] - start - 1.5) < 0.03, values
        # The other way, by itself.
        values = await hold(client, 1.5, position=NAN, velocity=3.0, stop_position=start)
        assert abs(values[Register.POSITION] - start) < 0.03, values

    run(simulated, test)


def test_spring_and_maximum_torque(simulated):
    """Pushed with less than its largest torque, a spring gives way; it never gives more."""

    async def test(client):
        values = await hold(client, 0.5, position=NAN)
        start = values[Register.POSITION]
        push = dict(position=NAN, kp_scale=0.2, kd_scale=0.2, feedforward_torque=0.006)
        values = await hold(client, 1.0, **push)
        assert values[Register.POSITION] > start + 0.005, (start, values)
        assert values[Register.MODE] == Mode.POSITION
        values = await hold(client, 0.5, position=NAN, maximum_torque=0.002, feedforward_torque=0.02)
        assert abs(values[Register.TORQUE]) < 0.004, values

    run(simulated, test)


def test_recapture(simulated):
    async def test(client):
        free = dict(position=NAN, kp_scale=0.0, kd_scale=0.0)
        start = (await hold(client, 0.5, position=NAN))[Register.POSITION]
        # Turned by hand, or by a load for a while.
        simulated.happen("load 0.005Nm" if BOARD else "turn 0.3")
        await until(client, lambda values: abs(values[Register.POSITION] - start) > 0.25, **free)
        if BOARD:
            simulated.happen("load 0Nm")
        # Until it rests.
        await hold(client, 1.0, **free)
        errors = await control_of(client)
        assert abs(errors[Register.POSITION_ERROR]) > 0.2, errors
        await client.set_recapture_position_velocity()
        await wait(client, 0.05)
        errors = await control_of(client)
        assert abs(errors[Register.POSITION_ERROR]) < 0.05, errors

    run(simulated, test)


def test_stay_within(simulated):
    async def test(client):
        start = (await hold(client, 0.5, position=NAN))[Register.POSITION]
        bounds = dict(lower_bound=start - 0.5, upper_bound=start + 0.5)
        for _ in range(50):
            values = (await client.set_stay_within(**bounds, feedforward_torque=0.006, query=True)).values
        assert values[Register.MODE] == Mode.STAY_WITHIN, values
        assert start + 0.4 < values[Register.POSITION] < start + 0.8, (start, values)

    run(simulated, test)


def test_zero_velocity(simulated):
    async def test(client):
        await until(client, lambda values: abs(values[Register.VELOCITY] - 5) < 1, position=NAN, velocity=5.0)
        for _ in range(50):
            values = (await client.set_zero_velocity(query=True)).values
        assert values[Register.MODE] == Mode.ZERO_VELOCITY and abs(values[Register.VELOCITY]) < 0.3, values

    run(simulated, test)


def test_velocity(simulated):
    async def test(client):
        for velocity in [5.0, -5.0]:
            close = lambda values: abs(values[Register.VELOCITY] - velocity) < 0.5
            await until(client, close, position=NAN, velocity=velocity)
            before = await hold(client, 0.02, position=NAN, velocity=velocity)
            after = await hold(client, 1.0, position=NAN, velocity=velocity)
            assert 0.5 < (after[Register.POSITION] - before[Register.POSITION]) / velocity < 2, (before, after)

    run(simulated, test)


def test_torque(simulated):
    async def test(client):
        free = dict(position=NAN, kp_scale=0.0, kd_scale=0.0, ilimit_scale=0.0)
        follows = lambda values: values[Register.MODE] == Mode.POSITION
        values = await until(client, follows, feedforward_torque=0.0, **free)
        for torque in [0.004, -0.004]:
            before = values[Register.VELOCITY]
            values = await hold(client, 0.3, feedforward_torque=torque, **free)
            # One measurement has two codes of noise, which on a board of 64 A is a tenth of an ampere.
            answers = [await hold(client, REQUEST_S, feedforward_torque=torque, **free) for _ in range(8)]
            torques = [answer[Register.TORQUE] for answer in answers]
            assert abs(sum(torques) / len(torques) - torque) < 0.0015, torques
            assert (values[Register.VELOCITY] - before) * torque > 0

    run(simulated, test)


def test_current(simulated):
    async def test(client):
        await hold(client, 0.5, position=NAN)
        # Not for long: nothing holds the motor back.
        for _ in range(4):
            values = (await client.set_current(d_A=0.0, q_A=0.3, query=True)).values
        assert values[Register.MODE] == Mode.CURRENT and abs(values[Register.Q_CURRENT] - 0.3) < 0.15, values

    run(simulated, test)


def test_what_no_limit_holds_in_is_refused(simulated):
    """A field of a voltage, and a voltage or a current in place of the regulated one: the protocol's error."""

    async def test(client):
        moves = dict(position=NAN, velocity=1.0, query=True)
        for value in [0.0, 1.0, -1e30, NAN, math.inf]:
            for command, error in [
                (client.make_vfoc(theta=value, voltage=value, theta_rate=1.0, query=True), b"\x30\x18\x01"),
                (client.make_vfoc(theta=0.0, voltage=1.0, theta_rate=value or 1e30, query=True), b"\x30\x1e\x01"),
                (client.make_position(**moves, fixed_voltage_override=value), b"\x30\x2a\x01"),
                (client.make_position(**moves, fixed_current_override=value), b"\x30\x2c\x01"),
            ]:
                command.parse = lambda message: message
                reply = await client.execute(command)
                assert error in bytes(reply.data), (error, bytes(reply.data))
        values = await wait(client, 0.2)
        assert values[Register.MODE] == Mode.STOPPED and values[Register.TORQUE] == 0, values

    run(simulated, test)


def test_brake(simulated):
    async def test(client):
        running = await until(client, lambda values: values[Register.VELOCITY] > 4.5, position=NAN, velocity=5)
        for _ in range(round(0.5 / REQUEST_S)):
            values = (await client.set_brake(query=True)).values
        assert values[Register.MODE] == Mode.BRAKE, values
        # Without a brake it runs on for 1.5 turns.
        assert values[Register.POSITION] - running[Register.POSITION] < 0.6, values

    run(simulated, test)


def test_bus(simulated):
    """The error counters of CAN, which are no registers of moteus: nothing was lost by what the other tests do."""

    async def test(client):
        registers = {0x700 + number: moteus.INT32 for number in range(5)}
        values = (await client.custom_query(registers)).values
        assert [values[register] for register in registers] == [0] * 5, values

    run(simulated, test)


def test_watchdog(simulated):
    async def test(client):
        await until(client, lambda values: abs(values[Register.VELOCITY] - 5) < 1, position=NAN, velocity=5.0)
        await hold(client, 0.02, position=NAN, velocity=5.0, watchdog_timeout=0.1)
        values = await wait(client, 1.5)
        assert values[Register.MODE] == Mode.TIMEOUT and abs(values[Register.VELOCITY]) < 0.5, values
        # Nothing but a stop ends it.
        assert (await hold(client, 0.2, position=NAN, velocity=5.0))[Register.MODE] == Mode.TIMEOUT
        await client.set_stop()
        assert (await wait(client, 0.05))[Register.MODE] == Mode.STOPPED

    run(simulated, test)


def test_stop(simulated):
    async def test(client):
        await until(client, lambda values: abs(values[Register.VELOCITY] - 5) < 1, position=NAN, velocity=5.0)
        await client.set_stop()
        values = await wait(client, 0.05)
        assert values[Register.MODE] == Mode.STOPPED and values[Register.TORQUE] == 0, values

    run(simulated, test)


def test_fault_and_clear(simulated):
    async def test(client):
        await until(client, lambda values: values[Register.MODE] == Mode.POSITION, position=NAN)
        # The Nucleo's limit is 50 V.
        simulated.happen("bus 55V" if "nucleo" in (BOARD or "") else "bus 40V")
        values = await until(client, lambda values: values[Register.MODE] == Mode.FAULT, position=NAN)
        assert values[Register.FAULT] == 34, values
        simulated.happen("bus 24V" if BOARD else "mend")
        await wait(client, 0.3)
        # A command does not clear it, a stop does.
        assert (await hold(client, 0.2, position=NAN))[Register.MODE] == Mode.FAULT
        await client.set_stop()
        values = await wait(client, 0.1)
        assert values[Register.MODE] == Mode.STOPPED and values[Register.FAULT] == 0, values
        await until(client, lambda values: values[Register.MODE] == Mode.POSITION, position=NAN)

    run(simulated, test)


def test_set_output(simulated):
    async def test(client):
        await client.set_output_exact(position=10.25)
        values = (await client.query()).values
        assert abs(values[Register.POSITION] - 10.25) < 0.01 and values[Register.HOME_STATE] == 2, values
        await client.set_output_nearest(position=-20.0)
        assert abs((await client.query()).values[Register.POSITION] + 20) <= 0.51
        # A commanded position is in the same numbers.
        target = -19.5
        await asyncio.wait_for(client.set_position_wait_complete(position=target), 300)
        assert abs((await hold(client, 0.3, position=target))[Register.POSITION] - target) < 0.02
        await client.set_stop()
        await client.set_require_reindex()
        assert (await client.query()).values[Register.HOME_STATE] == 0

    run(simulated, test)


def test_who_is_not_calibrated_says_so(uncalibrated):
    async def test(client):
        values = await until(client, lambda values: values[Register.MODE] == Mode.FAULT, position=NAN)
        assert values[Register.FAULT] == 36, values

    run(uncalibrated, test)
