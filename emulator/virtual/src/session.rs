//! One run of a virtual board.

use crate::angle::{Deviation, Periods, Told, deviations};
use crate::script::{Action, Step};
use anyhow::{Context, Result, bail};
use bus::{Bus, ResetCause};
use chip::can::wire::Wire;
use chip::{Board, Chip, Disturbance, Trace};
use cortex::{Entries, FIRST_IRQ, FaultReport, Image, Log, LogLine, Machine, PAINT, Rtt, Stop};
use hallservo_protocol::{Answer, Decoder, Reply};
use plant::PlantParameters;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

/// How often log, serial port and script are looked after, seconds of the board's time.
const SLICE_S: f64 = 100e-6;

/// A board with its firmware in flash, at power-on.
pub struct Session {
    /// Core and chip.
    pub machine: Machine<Chip>,
    /// The firmware's file.
    pub image: Rc<Image>,
    /// What was logged so far, the script's steps and the drive's replies among it.
    pub lines: Vec<LogLine>,
    /// Resets, with seconds.
    pub resets: Vec<(f64, ResetCause)>,
    /// What the motor did.
    pub trace: Trace,
    /// Telemetry that the drive was asked for.
    pub telemetry: Vec<Told>,
    periods: Periods,
    board: Arc<Board>,
    /// Of its CAN, as long as nobody else is there.
    wire: Option<Wire>,
    rtt: Option<Rtt>,
    log: Option<Log>,
    script: VecDeque<Step>,
    replies: Decoder,
    told_faults: usize,
}

/// A line that is not the firmware's.
fn note(at_ns: u64, level: &str, message: String) -> LogLine {
    LogLine { at_ns, level: level.into(), stamp: String::new(), message, place: String::new() }
}

impl Session {
    /// Flashes an image into a new board and applies power.
    ///
    /// # Errors
    /// An image that is no firmware or does not fit, or what is wrong with the motor's parameters.
    pub fn new(board: &Arc<Board>, elf: Vec<u8>, motor: &PlantParameters, seed: u64) -> Result<Session> {
        let image = Image::parse(elf).context("the firmware")?;
        let mut chip = Chip::new(Arc::clone(board), true, motor, seed).context("the motor")?;
        let size = chip.code().len();
        chip.load(0, &image.code(&chip.integration(), size)?);
        let log = Log::new(&image)?;
        Ok(Session {
            machine: Machine::new(chip),
            rtt: Rtt::find(&image),
            image: Rc::new(image),
            lines: Vec::new(),
            resets: Vec::new(),
            trace: Trace::default(),
            telemetry: Vec::new(),
            periods: Periods::default(),
            board: Arc::clone(board),
            wire: Some(Wire::default()),
            log,
            script: VecDeque::new(),
            replies: Decoder::new(),
            told_faults: 0,
        })
    }

    /// The same board once more, to go another way from here; log, script and what was recorded so far stay with this
    /// one.
    pub fn fork(&self) -> Session {
        Session {
            machine: self.machine.clone(),
            image: Rc::clone(&self.image),
            lines: Vec::new(),
            resets: Vec::new(),
            trace: Trace::default(),
            telemetry: Vec::new(),
            periods: self.periods.clone(),
            board: Arc::clone(&self.board),
            wire: self.wire.clone(),
            rtt: self.rtt,
            log: self.log.as_ref().map(Log::again),
            script: VecDeque::new(),
            replies: Decoder::new(),
            told_faults: self.told_faults,
        }
    }

    /// What will be done, by time.
    pub fn follow(&mut self, script: Vec<Step>) {
        self.script = script.into();
    }

    /// From now on somebody else [settles](Wire::settle) the wire of its CAN.
    pub fn share_wire(&mut self) {
        self.wire = None;
    }

    /// The board.
    pub fn board(&self) -> &Board {
        &self.board
    }

    /// Time since power-on, seconds.
    pub fn seconds(&self) -> f64 {
        self.machine.system.seconds(self.machine.now())
    }

    fn now_ns(&self) -> u64 {
        (self.seconds() * 1e9) as u64
    }

    /// Runs for 100 µs, less where the end or a step of the script comes first. Returns what the firmware has sent.
    ///
    /// # Errors
    /// A step of the script that the board cannot do.
    pub fn slice(&mut self, end_s: f64) -> Result<Vec<u8>> {
        let from_s = self.seconds();
        let step_s = self.script.front().map_or(f64::INFINITY, |step| step.at_s);
        let until_s = (from_s + SLICE_S).min(end_s).min(step_s.max(from_s));
        let cycles = ((until_s - from_s) * self.machine.system.clock_hz()).ceil().max(1.0) as u64;
        let stop = self.machine.run(self.machine.now() + cycles);
        self.tell_faults();
        match stop {
            Stop::Reset(cause) => {
                self.resets.push((self.seconds(), cause));
                self.lines.push(note(self.now_ns(), "RESET", format!("{cause:?}")));
                // The log begins anew; a frame that the reset has cut in two is lost.
                self.log = self.log.as_ref().map(Log::again);
                self.periods = Periods::default();
            }
            Stop::Breakpoint(_) | Stop::Lockup => bail!("the core stopped without a debugger"),
            Stop::Time => {}
        }
        self.read_log();
        while self.script.front().is_some_and(|step| step.at_s <= self.seconds()) {
            let Some(step) = self.script.pop_front() else { break };
            self.perform(step)?;
        }
        self.note_period();
        let now_s = self.seconds();
        if let Some(wire) = &mut self.wire {
            wire.settle(&mut [self.machine.system.can()], now_s);
        }
        let sent = self.machine.system.take_serial();
        self.read_replies(&sent);
        let trace = self.machine.system.take_trace();
        self.trace.names = trace.names;
        self.trace.rows.extend(trace.rows);
        Ok(sent)
    }

    /// Runs until a time, with nobody at the serial port.
    ///
    /// # Errors
    /// As [`Session::slice`].
    pub fn run_until(&mut self, end_s: f64) -> Result<()> {
        while self.seconds() < end_s {
            self.slice(end_s)?;
        }
        Ok(())
    }

    /// Bytes to the firmware's serial port.
    ///
    /// # Errors
    /// As long as the firmware has not set up its port.
    pub fn receive(&mut self, bytes: Vec<u8>) -> Result<(), String> {
        let now = self.machine.now();
        self.machine.system.disturb(&Disturbance::Serial(bytes), now)
    }

    /// Does a step of a script, whenever it was meant for.
    ///
    /// # Errors
    /// What the board cannot do.
    pub fn perform(&mut self, step: Step) -> Result<()> {
        self.lines.push(note(self.now_ns(), "SCRIPT", step.text.clone()));
        let now = self.machine.now();
        let done = match step.action {
            Action::Disturb(disturbance) => self.machine.system.disturb(&disturbance, now),
            Action::Hang(exception) => match exception.or_else(|| self.control_exception()) {
                Some(exception) => {
                    self.machine.hang(exception);
                    Ok(())
                }
                None => Err("there is no control interrupt yet".into()),
            },
        };
        done.map_err(anyhow::Error::msg).with_context(|| format!("the script, at {} s: {}", step.at_s, step.text))
    }

    /// The exception that the end of the sampling raises.
    pub fn control_exception(&self) -> Option<u16> {
        self.machine.system.last_sampling().map(|(line, _)| line + FIRST_IRQ)
    }

    /// From now on, what each function takes of the control interrupt is noted.
    pub fn watch_control(&mut self) {
        if let Some(exception) = self.control_exception() {
            self.machine.watch(exception);
            self.machine.forget_profile();
        }
    }

    /// Control periods that were seen whole.
    pub fn watched_periods(&self) -> u64 {
        let activity = self.control_exception().and_then(|number| self.machine.profile().activities().get(&number));
        activity.map_or(0, |activity| activity.cycles.count)
    }

    /// The last control period; the interrupt is entered once for each.
    fn note_period(&mut self) {
        let Some(exception) = self.control_exception() else { return };
        let Entries { count, origin } = self.machine.profile().entries(exception);
        if let (Some(number), Some(trigger)) = (count.checked_sub(1), origin) {
            self.periods.saw(number as u32, self.machine.system.seconds(trigger));
        }
    }

    /// What telemetry tells of the drive's angle in a span of time, against the motor's.
    pub fn deviations(&self, span_s: core::ops::Range<f64>) -> Vec<Deviation> {
        let facts = self.machine.system.facts();
        let halls = facts.sampling.iter().filter(|one| one.signal.starts_with("hall"));
        // One that is held earlier is brought up to the others by the firmware.
        let held_ns = halls.map(|one| one.held_ns.max - one.trigger_ns.max).fold(0.0, f64::max);
        deviations(&self.telemetry, held_ns * 1e-9, &self.trace, span_s)
    }

    fn read_log(&mut self) {
        let at_ns = self.now_ns();
        if let (Some(rtt), Some(log)) = (self.rtt, &mut self.log) {
            let bytes = rtt.read(&mut self.machine);
            self.lines.extend(log.decode(&bytes, at_ns));
        }
    }

    fn read_replies(&mut self, sent: &[u8]) {
        let at_ns = self.now_ns();
        for &byte in sent {
            match self.replies.push::<Reply>(byte) {
                None => {}
                Some(Ok(Reply { answer: Answer::Telemetry(frame), .. })) => {
                    let period_s = self.machine.system.facts().pwm.map_or(0.0, |pwm| 1.0 / pwm.hz);
                    self.telemetry.extend(self.periods.at_s(frame.step, period_s).map(|at_s| Told { at_s, frame }));
                }
                Some(Ok(reply)) => self.lines.push(note(at_ns, "REPLY", format!("#{} {:?}", reply.id, reply.answer))),
                Some(Err(error)) => self.lines.push(note(at_ns, "REPLY", format!("not understood: {error:?}"))),
            }
        }
    }

    fn tell_faults(&mut self) {
        for fault in &self.machine.faults[self.told_faults..] {
            let message = explain(fault, &self.image);
            self.lines.push(note((fault.at_s * 1e9) as u64, "FAULT", message));
        }
        self.told_faults = self.machine.faults.len();
    }

    /// Bytes of the stack, and how many of them were ever used; `None` where the firmware does not say where its stack
    /// is.
    pub fn stack(&self) -> Option<(u32, u32)> {
        let top = self.image.symbol("_stack_start")?;
        let bottom = ["_stack_end", "__sheap", "__ebss"].iter().find_map(|name| self.image.symbol(name))?;
        let stack = self.machine.ram(bottom, top.checked_sub(bottom)?)?;
        let untouched = stack.chunks_exact(4).take_while(|word| **word == PAINT.to_le_bytes()).count() as u32;
        Some((top - bottom, top - bottom - 4 * untouched))
    }
}

/// Function and line of an address, with the lines that it is inlined in.
pub fn place(image: &Image, pc: u32) -> String {
    let (place, lines) = (image.place(pc).to_string(), image.source(pc));
    if lines.len() > 1 { format!("{place} within {}", lines[1..].join(", ")) } else { place }
}

/// A fault, with function, line and registers.
pub fn explain(fault: &FaultReport, image: &Image) -> String {
    let mut text = format!("{}: {}", fault.exception, fault.what);
    if let Some(address) = fault.address {
        text += &format!(" ({address:#010x})");
    }
    if let (Some(bottom), Some(top)) = (image.symbol("_stack_end"), image.symbol("_stack_start"))
        && fault.registers[13] < bottom
    {
        let over = bottom - fault.registers[13];
        text += &format!("; stack overflow, {over} bytes more than the {} there are", top - bottom);
    }
    text += &format!(", at {:#010x} {}", fault.pc, place(image, fault.pc));
    text += &format!("\n    called from {}", image.place(fault.registers[14].wrapping_sub(2)));
    for (index, value) in fault.registers.iter().enumerate() {
        let name = ["SP", "LR"].get(index.wrapping_sub(13)).map_or_else(|| format!("R{index}"), |name| (*name).into());
        text += if index % 5 == 0 { "\n    " } else { "  " };
        text += &format!("{name:>3} {value:08x}");
    }
    text += &format!("\n    xPSR {:08x}  CFSR {:08x}  HFSR {:08x}", fault.xpsr, fault.cfsr, fault.hfsr);
    text
}
