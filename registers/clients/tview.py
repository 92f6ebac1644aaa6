"""tview at a simulated drive or a virtual board, used as a person does: `registers/tview` starts it."""

import asyncio
import os
import re
import sys
import types

import moteus
from conftest import BOARD, Simulated
from moteus_gui import tview


async def until(condition, what, seconds=900 if BOARD else 60):
    """Waits for what tview is to show; the time of a virtual board passes slowly."""
    for _ in range(10 * seconds):
        if condition():
            return
        await asyncio.sleep(0.1)
    raise AssertionError(f"never: {what}")


def most_a(drive_says):
    return float(re.search(r"([\d.]+) A", drive_says).group(1))


def child(item, *path):
    """The item below another one."""
    for name in path:
        items = [item.child(number) for number in range(item.childCount())]
        item = next(item for item in items if item.text(0) == name)
    return item


def plot(window, device, name, axis):
    """What the context menu does."""
    channel, field = name.split(".", 1)
    signal = device._telemetry_records[channel].get_signal(field)
    window.ui.plotItemCombo.addItem(name, window.ui.plotWidget.add_plot(name, signal, axis))


async def use(window, drive_says, picture):
    await until(lambda: window.devices, "a device")
    device = window.devices[0]
    telemetry, configuration = device._data_tree_item, device._config_tree_item
    await until(lambda: len(device._telemetry_records) == 5, "all channels")

    # The configuration has the drive's settings, and changes one.
    names = [configuration.child(number).text(0) for number in range(configuration.childCount())]
    assert names == ["id", "uuid", "servo"], names
    current = child(configuration, "servo", "max_current_a")
    assert float(current.text(1)) == most_a(drive_says), (current.text(1), drive_says)
    current.setText(1, "2.5")
    await asyncio.sleep(1)

    # Telemetry and plots.
    for item in [telemetry, child(telemetry, "servo_stats"), child(telemetry, "halls")]:
        item.setExpanded(True)
    configuration.setExpanded(True)
    child(configuration, "servo").setExpanded(True)
    stats = lambda name: child(telemetry, "servo_stats", name).text(1)
    await until(lambda: stats("bus_V").startswith(("23.", "24.")), "the bus voltage")
    for number, name in enumerate(["velocity", "q_A"]):
        plot(window, device, f"servo_stats.{name}", number)
    window.ui.telemetryDock.raise_()

    # The console moves the motor, there and back.
    for line in ["tel rate servo_stats 20", "d pos nan 4 nan a10"]:
        await window._run_user_command(line)
    await until(lambda: "position" in stats("mode") and float(stats("velocity")) > 3.5, "a motion")
    await asyncio.sleep(1)
    await window._run_user_command("d pos nan -4 nan a10")
    await until(lambda: float(stats("velocity")) < -3.5, "another one")
    await asyncio.sleep(1)
    await window._run_user_command("d stop")
    await until(lambda: "stopped" in stats("mode"), "a stop")
    await asyncio.sleep(1)

    image = window.ui.grab().toImage()
    os.makedirs(os.path.dirname(picture), exist_ok=True)
    assert image.save(picture), picture
    window.devices.clear()
    await asyncio.sleep(0.5)
    window.transport.close()


def main(picture):
    drive = Simulated()
    try:
        drive.hallctl("calibrate")
        setting = lambda: drive.hallctl("settings", "get", "max_current_a").stdout
        before = setting()
        app = tview.QtWidgets.QApplication(sys.argv[:1])
        loop = tview.asyncqt.QEventLoop(app)
        asyncio.set_event_loop(loop)
        options = types.SimpleNamespace(devices=["1"], can_prefix=0)
        for name, value in vars(moteus_options(drive.port)).items():
            setattr(options, name, value)
        window = tview.TviewMainWindow(options)
        window.ui.resize(1300, 800)
        window.show()
        loop.run_until_complete(use(window, before, picture))
        assert most_a(setting()) == 2.5 != most_a(before)
        print(f"tview shows the drive: {picture}")
    finally:
        drive.end()
    # Its tasks have no end of their own.
    sys.stdout.flush()
    os._exit(0)


def moteus_options(port):
    import argparse

    parser = argparse.ArgumentParser()
    moteus.make_transport_args(parser)
    return parser.parse_args(["--force-transport", "fdcanusb", "--fdcanusb", port])


if __name__ == "__main__":
    main(sys.argv[1])
