"""The diagnostic channel: what users of moteus_tool do, and what it parses."""

import asyncio
import json
import subprocess
import sys

import moteus
import pytest
from conftest import BUS

pytestmark = pytest.mark.skipif(BUS, reason="the firmware for CAN-FD of the small board has no diagnostic channel")

# A machine that is busy is no reason to ask again, which puts the channel out of step: their own time-outs are 0.2 s.
PATIENCE_S = 30
# The tool as it is, but with that patience.
TOOL = f"""
import moteus.fdcanusb_device as device
from moteus import moteus_tool
device.DEFAULT_COMMAND_TIMEOUT = device.DEFAULT_RESPONSE_TIMEOUT = {PATIENCE_S}
moteus_tool.main()
"""


def tool(drive, *arguments):
    """Runs moteus_tool as a person does."""
    transport = ["--force-transport", "fdcanusb", "--fdcanusb", drive.port]
    command = [sys.executable, "-c", TOOL, *transport, "-t", "1", *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def dump(drive):
    lines = tool(drive, "--dump-config").strip().splitlines()
    return dict(line.split(" ", 1) for line in lines)


def run(drive, test):
    """Runs a test with a stream of the diagnostic channel."""

    async def whole():
        transport = moteus.Fdcanusb(drive.port, command_timeout=PATIENCE_S, response_timeout=PATIENCE_S)
        client = moteus.Controller(id=1, transport=transport)
        stream = moteus.Stream(client)
        try:
            await stream.write_message(b"tel stop")
            await stream.flush_read()
            await test(client, stream)
            await stream.command(b"d stop")
        finally:
            transport.close()

    asyncio.run(asyncio.wait_for(whole(), 600))


async def refused(stream, line):
    with pytest.raises(moteus.CommandError) as error:
        await stream.command(line)
    return str(error.value)


def test_info(simulated):
    info = json.loads(tool(simulated, "--info"))
    assert len(info["git_hash"]) == 40 and len(info["uuid"]) == 36 and int(info["model"], 16) != 0


def test_all_settings_are_dumped_as_the_own_tool_has_them(simulated):
    listed = json.loads(simulated.hallctl("--json", "settings", "list").stdout)
    values = dump(simulated)
    assert values.pop("id.id") == "1"
    assert [f"servo.{setting['name']}" for setting in listed] == list(values)
    for setting in listed:
        if isinstance(setting["value"], float | int):
            value = values[f"servo.{setting['name']}"]
            assert float(value) == pytest.approx(float(setting["value"]), rel=1e-6), setting


def test_a_dump_is_restored_and_saved(simulated, tmp_path):
    before = dump(simulated)
    # A setting that another one's range depends on comes before it, up as well as down.
    changes = {"servo.max_current_a": "2.5", "servo.current_bandwidth_hz": "1200", "servo.speed_bandwidth_hz": "50"}
    changed = tmp_path / "changed.cfg"
    changed.write_text("".join(f"conf set {name} {value}\n" for name, value in changes.items()))
    assert "could not" not in tool(simulated, "--write-config", str(changed))
    assert dump(simulated) == before | changes
    whole = tmp_path / "whole.cfg"
    whole.write_text("".join(f"{name} {value}\n" for name, value in before.items()))
    # With values that cannot be set, but are the same.
    assert "could not" not in tool(simulated, "--restore-config", str(whole))
    assert dump(simulated) == before
    # It was saved: the flash has it.
    tool(simulated, "--write-config", str(changed))
    simulated.hallctl("settings", "load")
    assert dump(simulated) == before


def test_what_cannot_be_set_is_named(simulated, tmp_path):
    wrong = tmp_path / "wrong.cfg"
    wrong.write_text("servo.max_current_a 1000\nservo.nonsense 1\nservo.adc_bits 10\nservo.pole_pairs 4\n")
    out = tool(simulated, "--restore-config", str(wrong))
    assert [line.strip() for line in out.splitlines() if line.startswith(" servo")] == [
        "servo.max_current_a 1000", "servo.nonsense 1", "servo.adc_bits 10"
    ]

    async def test(_, stream):
        assert "max_current_a is 1000, but" in await refused(stream, b"conf set servo.max_current_a 1000")
        assert "stall_s is 99, but must be from" in await refused(stream, b"conf set servo.stall_s 99")
        assert "follows from the board" in await refused(stream, b"conf set servo.adc_bits 10")
        assert "whole numbers" in await refused(stream, b"conf set servo.pole_pairs 4.5")
        assert "unknown command" in await refused(stream, b"jump")

    run(simulated, test)


def test_every_channel_is_read(simulated):
    stats = json.loads(tool(simulated, "--read", "servo_stats"))
    assert stats["mode"] == 0 and abs(stats["bus_V"] - 24) < 0.5 and abs(stats["fet_temp_C"] - 25) < 1
    halls = json.loads(tool(simulated, "--read", "halls"))
    assert halls["calibrated"] and len(halls["code"]) == 3 and abs(halls["amplitude"] - 1) < 0.1
    firmware = json.loads(tool(simulated, "--read", "firmware"))
    assert firmware["board"] and len(firmware["serial_number"]) == 3
    assert len(json.loads(tool(simulated, "--read", "git"))["hash"]) == 20


def test_a_motion_by_text(simulated):
    async def test(_, stream):
        await stream.command(b"d pos nan 3 nan")
        for _ in range(100):
            stats = await stream.read_data("servo_stats")
            if abs(stats.velocity - 3) < 0.5:
                break
            await asyncio.sleep(0.05)
        assert stats.mode.name == "position" and abs(stats.velocity - 3) < 0.5, stats
        # While the bridge is on, settings are as they are.
        assert "not while Running" in await refused(stream, b"conf set servo.max_current_a 2")
        await stream.command(b"d stop")
        await asyncio.sleep(0.05)
        assert (await stream.read_data("servo_stats")).mode.name == "stopped"

    run(simulated, test)


def test_telemetry_comes_by_itself(simulated):
    async def test(_, stream):
        await stream.command(b"tel rate halls 20")
        received = b""
        while received.count(b"emit halls") < 10:
            received += await stream.read(61, block=False)
        await stream.write_message(b"tel stop")
        await asyncio.sleep(0.1)
        await stream.flush_read()

    run(simulated, test)
