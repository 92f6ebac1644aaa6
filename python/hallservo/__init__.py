"""A hallservo drive from Python: real, virtual or simulated, by the client of hallctl."""

from ._hallservo import Drive, DriveError, connect

__all__ = ["Drive", "DriveError", "connect"]
