"""The same drive for asyncio: `async with hallservo.aio.connect(port) as drive: await drive.calibrate()`.

Each drive has a thread of its own, in which its requests wait their turn, so that several drives and everything else go
on beside each other. A task that is cancelled amid a request stops the motor, and so does `stop`, whatever goes on.
"""

import asyncio
import inspect
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

from . import _hallservo

__all__ = ["Drive", "connect"]


@asynccontextmanager
async def connect(port, patience=3.0):
    """Opens a drive for the block, and stops its motor in the end, whatever has happened."""
    drive = Drive()
    try:
        await drive._open(port, patience)
        yield drive
    finally:
        await drive.close()


class Drive:
    """A drive: each method does what that of `hallservo.Drive` does, and is awaited."""

    def __init__(self):
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="hallservo")
        self._cancel = _hallservo.Cancel()
        self._drive = None
        self._closed = False

    async def _in_thread(self, work):
        if self._closed:
            raise _hallservo.DriveError("it is closed")
        future = self._thread.submit(work)
        try:
            return await asyncio.wrap_future(future)
        except asyncio.CancelledError:
            # What waited for its turn has done nothing.
            if future.cancelled():
                raise
            # What goes on in the thread brakes the motor, switches the bridge off, and ends.
            await self._stop()
            raise

    async def _stop(self, then=None):
        self._cancel.set(True)
        try:
            await asyncio.shield(asyncio.wrap_future(self._thread.submit(then or self._halt)))
        finally:
            self._cancel.set(False)

    def _halt(self):
        if self._drive is not None:
            self._drive.stop()

    async def _open(self, port, patience):
        def open_it():
            self._drive = _hallservo.cancellable(port, patience, self._cancel)

        await self._in_thread(open_it)

    async def _call(self, name, *values, **named):
        return await self._in_thread(lambda: getattr(self._drive, name)(*values, **named))

    async def board(self):
        """What it calls itself."""

        return await self._in_thread(lambda: self._drive.board)

    async def stop(self):
        """Brakes, then bridge off, at once: what goes on ends with a `DriveError`."""
        if self._closed:
            raise _hallservo.DriveError("it is closed")
        await self._stop()

    async def close(self):
        """Stops the motor, if this has moved it, and lets others have the drive."""

        if self._closed:
            return
        self._closed = True

        def close_it():
            drive, self._drive = self._drive, None
            if drive is not None:
                drive.close()

        try:
            await self._stop(close_it)
        finally:
            self._thread.shutdown(wait=False)


def _method(name):
    async def method(self, *values, **named):
        return await self._call(name, *values, **named)

    method.__name__ = name
    method.__qualname__ = f"Drive.{name}"
    # What it takes is what the other takes.
    method.__doc__ = getattr(_hallservo.Drive, name).__doc__
    method.__signature__ = inspect.signature(getattr(_hallservo.Drive, name))
    return method


for _name in (
    "status arm clear voltage torque speed position impedance calibrate identify get set settings save telemetry record"
).split():
    setattr(Drive, _name, _method(_name))
