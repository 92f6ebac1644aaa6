# Written by python/stubs out of __init__.pyi, which is what is to be changed.
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Drive", "connect"]

def connect(port: str, patience: float = 3.0) -> AbstractAsyncContextManager[Drive]:
    """Opens a drive for the block, and stops its motor in the end, whatever has happened."""

class Drive:
    """A drive: each method does what that of `hallservo.Drive` does, and is awaited.

    They wait their turn, but for `stop`: what goes on ends with a `DriveError`.
    """

    async def board(self) -> str: ...
    async def status(self) -> dict[str, Any]:
        """As `hallctl status --json`: state, fault, limits, position_turns, speed_rad_s, current_a, …; None where a
        quantity is not measured."""
    async def arm(self) -> None:
        """Bridge on, the shaft held; returns when wires, amplifiers and direction have been checked."""
    async def stop(self) -> None:
        """Brakes, then bridge off."""
    async def clear(self) -> None:
        """The fault has been taken note of; refused where there is none."""
    async def voltage(self, share: float) -> None:
        """-1 to 1. A command holds for the setting command_timeout_s."""
    async def torque(self, newton_metres: float) -> None: ...
    async def speed(self, rad_s: float) -> None: ...
    async def position(self, turns: float) -> None: ...
    async def impedance(
        self,
        position: float | None = None,
        *,
        kp: float | None = None,
        kd: float | None = None,
        torque: float = 0.0,
        max_torque: float | None = None,
        velocity: float = 0.0,
        stop: float | None = None,
        within: tuple[float, float] | None = None,
    ) -> None:
        """A spring (kp, N·m/rad) and a damper (kd, N·m·s/rad) at the shaft.

        It is at rest at a position in turns, or where the rotor is, or moves with a velocity in rad/s up to a stop;
        within a range there is nothing but the feed-forward torque. Without kp and kd: by the bandwidths in the
        settings.
        """
    async def calibrate(self) -> dict[str, Any]:
        """Turns the rotor both ways and finds out what the Halls deliver: as `hallctl calibrate --json`."""
    async def identify(self) -> dict[str, Any]:
        """Turns to and fro and measures the motor, from a drive that is ready."""
    async def get(self, name: str) -> float: ...
    async def set(self, name: str, value: float) -> float:
        """Until the power goes, or for good after `save`; while the bridge is off, bandwidths at any time."""
    async def settings(self) -> dict[str, float]: ...
    async def save(self) -> bool:
        """True when they are in the flash; otherwise they will be when the motor rests, bridge off."""
    async def telemetry(
        self,
        seconds: float,
        hz: float = 1000.0,
        *,
        torque: float | None = None,
        speed: float | None = None,
        position: float | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Telemetry, by quantity, on the drive's clock; meanwhile the motor follows what is asked for."""
    async def record(
        self,
        channels: Sequence[str] | None = None,
        *,
        every: int = 1,
        rows: int | None = None,
        trigger: str = "now",
        before: float = 0.25,
        seconds: float | None = None,
        torque: float | None = None,
        speed: float | None = None,
        position: float | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """The drive's scope: up to four channels, a row every so many control periods, about a trigger.

        Channels: phase_a|b|c, i_d, i_q, i_d_ref, i_q_ref, v_d, v_q, duty_a|b|c, angle, speed, speed_ref, position,
        position_ref, bus, hall_1|2|3; without, the references of i_q and speed and what follows them.
        Trigger: now, command (the next one), fault, or a channel that crosses a level: "i_q>1.5", "speed<-100rpm".
        Without `rows` as many as the drive's memory holds. `before` is the share of them before the trigger, and `time_s` is zero there.
        `seconds` is the longest wait; without, until Ctrl-C. The motor follows what is asked for as soon as the rows
        before the trigger are taken; until then a command from before holds for the setting command_timeout_s.
        """
    async def close(self) -> None:
        """Stops the motor, if this has moved it, and lets others have the drive."""
