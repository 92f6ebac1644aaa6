//! `hallctl list`: ports that may be boards.

use crate::error::Result;
use crate::out::Out;
use crate::say;
use anyhow::Context;
use serde_json::json;
use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo, available_ports};

/// STMicroelectronics: the ST-LINK of a Nucleo and of the ESC1.
const ST: u16 = 0x0483;

pub(super) fn list(out: Out) -> Result<()> {
    let ports = available_ports().context("cannot look for serial ports")?;
    let usb: Vec<_> = ports.iter().filter_map(|port| Some((port, usb(port)?))).collect();
    for (port, usb) in &usb {
        let likely = if usb.vid == ST { "  ← probably a board" } else { "" };
        say!(out, "{:<16} {:04x}:{:04x}  {}{likely}", port.port_name, usb.vid, usb.pid, name(usb))?;
    }
    if usb.is_empty() {
        say!(out, "No serial port by USB. Is the board plugged in? A simulated drive says its own port.")?;
    }
    let values = usb.iter().map(|(port, usb)| {
        json!({
            "port": port.port_name,
            "vendor": usb.vid,
            "product": usb.pid,
            "name": name(usb),
            "serial_number": usb.serial_number,
            "likely": usb.vid == ST,
        })
    });
    out.value(&values.collect::<Vec<_>>())
}

fn usb(port: &SerialPortInfo) -> Option<&UsbPortInfo> {
    match &port.port_type {
        SerialPortType::UsbPort(usb) => Some(usb),
        _ => None,
    }
}

fn name(usb: &UsbPortInfo) -> String {
    let parts = [&usb.manufacturer, &usb.product, &usb.serial_number];
    parts.into_iter().flatten().cloned().collect::<Vec<_>>().join(" ")
}
