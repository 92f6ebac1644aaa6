"""From import to the plot of a step response: python examples/step.py tcp:127.0.0.1:PORT step.png"""

import sys

import hallservo
import matplotlib.pyplot as plt
import numpy as np

with hallservo.connect(sys.argv[1]) as drive:
    if not drive.status()["calibrated"]:
        drive.calibrate()
    drive.arm()
    before = drive.telemetry(0.5, hz=500, speed=40.0)
    after = drive.telemetry(0.5, hz=500, speed=60.0)

rise = after["time_s"][np.argmax(after["speed_rad_s"] > 58.0)]
plt.plot(before["time_s"] - before["time_s"][-1], before["speed_rad_s"])
plt.plot(after["time_s"], after["speed_rad_s"])
plt.title(f"58 of 60 rad/s after {1e3 * rise:.0f} ms")
plt.xlabel("s")
plt.ylabel("rad/s")
plt.savefig(sys.argv[2])
