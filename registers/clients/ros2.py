"""The ROS 2 node `moteus_control` at a simulated drive, without ROS: `registers/ros2` starts it. The node's own file is
run as it is; this stands in for what it asks of `rclpy`, `std_msgs` and `moteus_msgs`."""

import array
import math
import os
import queue
import runpy
import sys
import threading
import time
import traceback
import types

from conftest import Simulated

FLOATS = "position velocity torque motor_temperature voltage temperature".split()
BYTES = "mode trajectory_complete home_state fault_code".split()
LISTS = [
    "position", "velocity", "feedforward_torque", "kp_scale", "kd_scale", "maximum_torque", "stop_position",
    "watchdog_timeout", "velocity_limit", "accel_limit", "fixed_voltage_override",
]


class ControllerState:
    """Takes nothing but what a message of ROS takes."""

    def __setattr__(self, name, value):
        if name in BYTES:
            assert isinstance(value, int) and 0 <= value < 256, (name, value)
        else:
            assert name in FLOATS and isinstance(value, float), (name, value)
        super().__setattr__(name, value)


class PositionCommand:
    """Lists of `float`; an empty one says nothing."""

    __slots__ = [*(f"_{name}" for name in LISTS), "_check_fields"]

    def __init__(self, **values):
        for name in LISTS:
            setattr(self, f"_{name}", array.array("f", [values.pop(name)] if name in values else []))
        assert not values, values


def empty():
    return types.SimpleNamespace()


def number(data):
    return types.SimpleNamespace(data=data)


class Node:
    """One thread calls back, as `rclpy.spin` does."""

    PARAMETERS = {}

    def __init__(self, name):
        self.name, self.values, self.callbacks, self.queue = name, {}, {}, queue.Queue()
        self.tick, self.state, self.states = None, None, 0
        Node.one = self

    def declare_parameter(self, name, default):
        self.values[name] = self.PARAMETERS.get(name, default)

    def get_parameter(self, name):
        return types.SimpleNamespace(value=self.values[name])

    def create_subscription(self, _kind, topic, callback, _depth):
        self.callbacks[topic] = callback

    def create_publisher(self, _kind, topic, _depth):
        assert topic == "id_1/state", topic
        return self

    def publish(self, state):
        self.state, self.states = state, self.states + 1

    def create_timer(self, _period, callback):
        self.tick = callback

    def get_logger(self):
        return types.SimpleNamespace(info=print)

    def spin(self):
        while True:
            # The simulated drive's time passes by requests.
            while not self.tick:
                time.sleep(0.01)
            while not self.queue.empty():
                topic, message = self.queue.get()
                self.callbacks[f"id_1/{topic}"](message)
            self.tick()

    def tell(self, topic, message):
        self.queue.put((topic, message))

    def states_later(self, count):
        """The state after so many more of them."""
        end = self.states + count
        while self.states < end:
            time.sleep(0.001)
        return self.state

    def until(self, condition, what, topic=None, message=None):
        """Says the same again and again until the state is as wanted."""
        for _ in range(500):
            if topic:
                self.tell(topic, message)
            state = self.states_later(2)
            if condition(state):
                return state
        raise AssertionError(f"never: {what}: {vars(state)}")


def module(name, **content):
    sys.modules[name] = types.ModuleType(name)
    vars(sys.modules[name]).update(content)


def stand_in():
    module("rclpy", init=lambda args: None, spin=lambda node: node.spin())
    module("rclpy.node", Node=Node)
    module("std_msgs")
    module("std_msgs.msg", Empty=empty, Float32=number)
    sys.modules["std_msgs"].msg = sys.modules["std_msgs.msg"]
    module("moteus_msgs")
    module("moteus_msgs.msg", PositionCommand=PositionCommand, ControllerState=ControllerState)


def use(node):
    """Every topic of the node."""
    nan = math.nan
    state = node.until(lambda state: state.mode == 0, "a drive at rest")
    assert 23 < state.voltage < 25 and 24 < state.temperature < 26 and state.fault_code == 0, vars(state)

    turning = PositionCommand(position=nan, velocity=2.0)
    turns = lambda state: state.mode == 10 and abs(state.velocity - 2) < 0.5
    node.until(turns, "2 turns a second", "cmd_position", turning)
    node.until(lambda state: state.mode == 15 and abs(state.velocity) < 0.5, "a brake", "cmd_brake", empty())
    node.tell("cmd_stop", empty())
    node.until(lambda state: state.mode == 0, "a stop")

    node.tell("cmd_set_output_exact", number(10.25))
    node.until(lambda state: abs(state.position - 10.25) < 0.05 and state.home_state == 2, "a position that was set")
    node.tell("cmd_set_output_nearest", number(-20.0))
    state = node.until(lambda state: abs(state.position + 20) < 0.6, "the nearest turn")
    target = state.position + 0.5
    everything = PositionCommand(
        position=target, velocity=0.0, feedforward_torque=0.0, kp_scale=1.0, kd_scale=1.0, maximum_torque=0.03,
        stop_position=nan, watchdog_timeout=0.5, velocity_limit=4.0, accel_limit=20.0,
    )
    arrived = lambda state: state.trajectory_complete == 1 and abs(state.position - target) < 0.02
    node.until(arrived, "a position", "cmd_position", everything)
    node.tell("cmd_recapture_position_velocity", empty())
    assert node.states_later(5).mode == 10

    # Nobody repeats the command: it ends by itself, until a stop.
    node.until(lambda state: state.mode == 11, "a time-out")
    node.tell("cmd_stop", empty())
    node.until(lambda state: state.mode == 0, "a stop")
    for _ in range(30):
        node.tell("cmd_position", PositionCommand(position=nan, velocity=1.0, fixed_voltage_override=1.0))
        state = node.states_later(2)
        assert state.mode == 0 and abs(state.velocity) < 0.5, "a fixed voltage is refused"


def main(path):
    drive = Simulated("--speed", "fast")

    def watch():
        try:
            while not hasattr(Node, "one"):
                time.sleep(0.01)
            use(Node.one)
            print("every topic of the node did what it is for", flush=True)
        except BaseException:
            traceback.print_exc()
            end(1)
        end(0)

    def end(code):
        drive.end()
        # Its loop has no end of its own.
        os._exit(code)

    def complain(failure):
        traceback.print_exception(failure.exc_value)
        end(1)

    # Also what its callbacks raise.
    threading.excepthook = complain
    drive.hallctl("calibrate")
    Node.PARAMETERS = {"args": ["--force-transport", "fdcanusb", "--fdcanusb", drive.port]}
    stand_in()
    threading.Thread(target=watch, daemon=True).start()
    runpy.run_path(path, run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1])
