#!/usr/bin/env python3
"""Frames, numbers and lines as the real client makes them, for the tests: `pip install moteus==1.1.1`, then
`registers/tests/golden.py > registers/tests/golden.txt`.

    command NAME FRAME register=value ...    what a command writes, as float
    number QUANTITY FORMAT VALUE BYTES       how a value is scaled
    line IDENTIFIER FRAME LINE               how a frame is a line
"""

import io
import math

import moteus
from moteus import fdcanusb_device, multiplex, protocol

NAN = math.nan
R = moteus.Register


def commands():
    c = moteus.Controller(id=1)
    yield "stop", c.make_stop(), {R.MODE: 0}
    yield "position", c.make_position(position=1.5, velocity=-0.25), {
        R.MODE: 10, R.COMMAND_POSITION: 1.5, R.COMMAND_VELOCITY: -0.25,
    }
    everything = dict(
        position=NAN, velocity=2.0, feedforward_torque=0.03, kp_scale=0.5, kd_scale=0.25, maximum_torque=0.04,
        stop_position=7.5, watchdog_timeout=0.2, velocity_limit=3.0, accel_limit=40.0,
    )
    registers = range(R.COMMAND_POSITION, R.COMMAND_ACCEL_LIMIT + 1)
    yield "everything", c.make_position(**everything), {R.MODE: 10, **dict(zip(registers, everything.values()))}
    short = moteus.PositionResolution()
    for name in everything:
        setattr(short, name, moteus.INT16)
    shorter = moteus.Controller(id=1, position_resolution=short)
    yield "everything as int16", shorter.make_position(**everything), {
        R.MODE: 10, **dict(zip(registers, everything.values()))
    }
    yield "sparse", c.make_position(position=0.5, kp_scale=0.0, stop_position=1.0), {
        R.MODE: 10, R.COMMAND_POSITION: 0.5, R.COMMAND_KP_SCALE: 0.0, R.COMMAND_STOP_POSITION: 1.0,
    }
    yield "current", c.make_current(d_A=0.0, q_A=1.25), {
        R.MODE: 9, R.COMMAND_Q_CURRENT: 1.25, R.COMMAND_D_CURRENT: 0.0,
    }
    yield "stay within", c.make_stay_within(lower_bound=-1.0, upper_bound=2.0, maximum_torque=0.02), {
        R.MODE: 13, R.COMMAND_WITHIN_LOWER_BOUND: -1.0, R.COMMAND_WITHIN_UPPER_BOUND: 2.0,
        R.COMMAND_WITHIN_MAX_TORQUE: 0.02,
    }
    yield "zero velocity", c.make_zero_velocity(kd_scale=0.5), {R.MODE: 12, R.COMMAND_KD_SCALE: 0.5}
    yield "brake", c.make_brake(), {R.MODE: 15}
    yield "nearest", c.make_set_output_nearest(position=0.25), {R.SET_OUTPUT_NEAREST: 0.25}
    yield "exact", c.make_set_output_exact(position=-3.5), {R.SET_OUTPUT_EXACT: -3.5}
    yield "recapture", c.make_recapture_position_velocity(), {R.RECAPTURE_POSITION_VELOCITY: 1}
    yield "reindex", c.make_require_reindex(), {R.REQUIRE_REINDEX: 1}


QUANTITIES = {
    "Position": "write_position", "Velocity": "write_velocity", "Acceleration": "write_accel",
    "Torque": "write_torque", "Share": "write_pwm", "Voltage": "write_voltage", "Temperature": "write_temperature",
    "Time": "write_time", "Current": "write_current", "Power": "write_power",
}
FORMATS = {"Int8": multiplex.INT8, "Int16": multiplex.INT16, "Int32": multiplex.INT32, "Float": multiplex.F32}


def numbers():
    for quantity, write in QUANTITIES.items():
        for name, number in FORMATS.items():
            for value in [0.0, 0.5, -0.5, 1.0, 1e9, -1e9, NAN]:
                bytes_ = io.BytesIO()
                getattr(protocol.Writer(bytes_), write)(value, number)
                yield quantity, name, value, bytes_.getvalue().hex()


def main():
    for name, command, registers in commands():
        values = " ".join(f"{int(register):#05x}={value}" for register, value in registers.items())
        print(f"command {name.replace(' ', '-')} {command.data.hex()} {values}")
    for number in numbers():
        print("number", *number)
    query = moteus.Controller(id=1).make_query()
    for identifier, data in [(0x8001, query.data), (0x8001, b""), (0x1234_8001, bytes(range(64)))]:
        line = f"can send {identifier:04x} {data.hex().upper()} bF".encode()
        print("line", f"{identifier:x}", data.hex() or "-", line.decode())
        print("line", f"{identifier:x}", data.hex() or "-", fdcanusb_device._append_checksum(line).decode())


main()
