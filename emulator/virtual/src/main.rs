//! `cargo virtual BOARD`: the firmware that would be flashed, on a virtual board.

use anyhow::{Context, Result, bail};
use chip::Board;
use clap::Parser;
use cortex::LogLine;
use indicatif::{ProgressBar, ProgressStyle};
use plant::PlantParameters;
use std::fs::File;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use virtual_board::adapter::Adapter;
use virtual_board::bus::Bus;
use virtual_board::{firmware, outcome::Outcome, report, script, serial::Line, session::Session, typed::Typed};

/// From look to look at the serial port while time stands still.
const LOOK: Duration = Duration::from_millis(1);

/// Runs the very firmware that would be flashed on a virtual STM32G4 with a simulated motor, and reports what it did.
#[derive(Parser)]
#[command(name = "cargo virtual")]
struct Arguments {
    /// Name of a folder in boards/ with a virtual.toml; several with --bus
    #[arg(required = true)]
    boards: Vec<String>,
    /// All of the boards on one CAN, with the identifiers 1, 2, 3, …; --serial is that of an fdcanusb adapter
    #[arg(long, conflicts_with_all = ["script", "json", "out", "watch"])]
    bus: bool,
    /// Each board calibrates first, alone
    #[arg(long, requires = "bus")]
    calibrated: bool,
    /// Virtual time to run; without end with --serial, else 1 s
    #[arg(long, value_parser = seconds)]
    seconds: Option<f64>,
    /// What happens to the board, and when
    #[arg(long)]
    script: Option<PathBuf>,
    /// All figures and the log, as JSON
    #[arg(long)]
    json: Option<PathBuf>,
    /// Folder for report.html and trace.csv
    #[arg(long)]
    out: Option<PathBuf>,
    /// Where tools connect to: tcp:127.0.0.1:PORT or pty
    #[arg(long)]
    serial: Option<String>,
    /// Lines of standard input are events as in a script, and happen at once; with --bus to the first board
    #[arg(long, requires = "serial")]
    typed: bool,
    /// Each request of a tool is worth 50 ms, or what its answer takes, as fast as this machine computes, and a line of
    /// text 2 ms; else time stands still
    #[arg(long, requires = "serial")]
    wait: bool,
    /// The board's firmware for two rings on the shaft
    #[arg(long, conflicts_with = "elf")]
    encoder: bool,
    /// Two Halls, the second so many electrical degrees from the first, and nothing at the third input; the drive is told
    /// by its setting `halls`
    #[arg(long, value_name = "DEGREES", num_args = 0..=1, default_missing_value = "90", allow_negative_numbers = true, value_parser = apart)]
    two_halls: Option<f64>,
    /// The firmware, instead of building the board's
    #[arg(long)]
    elf: Option<PathBuf>,
    /// How the flash fills a line of its cache, which the reference manual leaves open: word by word, and the next miss
    /// waits; or at once
    #[arg(long, value_enum, default_value_t = Fill::Words)]
    fill: Fill,
    /// Begins to note how long the control interrupt takes at this time, s
    #[arg(long, default_value_t = 0.02)]
    watch: f64,
    /// Seed of the motor's imperfections and the sensors' noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Fill {
    Words,
    Once,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| *seconds > 0.0 && *seconds <= 1e9);
    seconds.ok_or_else(|| "a number of seconds above 0 is wanted".into())
}

fn apart(text: &str) -> Result<f64, String> {
    let apart_deg = text.parse().ok().filter(|apart_deg: &f64| (20.0..=160.0).contains(&apart_deg.abs()));
    apart_deg.ok_or_else(|| "20 to 160 electrical degrees are wanted, or as many in the other direction".into())
}

/// That what is found can be kept is seen to before it is looked for.
fn make_room(arguments: &Arguments) -> Result<()> {
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    if let Some(path) = &arguments.json {
        let tried = File::options().write(true).create(true).truncate(false).open(path);
        tried.with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

fn main() -> Result<ExitCode> {
    let arguments = Arguments::parse();
    if arguments.bus {
        return together(&arguments);
    }
    let [board] = &arguments.boards[..] else { bail!("several boards are run with --bus") };
    let board = firmware::board(board)?;
    let steps = arguments.script.as_ref().map(|path| {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        script::parse(&text).with_context(|| path.display().to_string())
    });
    let steps = steps.transpose()?;
    make_room(&arguments)?;
    let mut session = at_power_on(&arguments, &board, arguments.seed)?;
    session.follow(steps.unwrap_or_default());

    let end_s = arguments.seconds.unwrap_or(if arguments.serial.is_some() { f64::INFINITY } else { 1.0 });
    let line = arguments.serial.as_deref().map(|description| Line::open(description, arguments.wait)).transpose()?;
    run(&mut session, end_s, &arguments, line)?;

    let outcome = Outcome::of(&session);
    println!("{}", report::text(&outcome));
    if let Some(path) = &arguments.json {
        std::fs::write(path, outcome.json()?).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if let Some(folder) = &arguments.out {
        std::fs::write(folder.join("report.html"), report::html(&outcome, &session.trace)?)?;
        std::fs::write(folder.join("trace.csv"), report::csv(&session.trace))?;
        println!("plots: {}", folder.join("report.html").display());
    }
    Ok(if outcome.verdict().is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// A board with its firmware, and a motor of this seed.
fn at_power_on(arguments: &Arguments, board: &Arc<Board>, seed: u64) -> Result<Session> {
    let build = || match (arguments.bus, arguments.encoder) {
        (true, _) => firmware::build_for_bus(board),
        (false, true) => firmware::build_with_encoder(&board.name),
        (false, false) => firmware::build(&board.name),
    };
    let elf = arguments.elf.clone().map_or_else(build, Ok)?;
    let image = std::fs::read(&elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let motor = PlantParameters::imperfect(seed);
    let motor = arguments.two_halls.map_or(motor, |apart_deg| motor.with_two_halls(apart_deg));
    let mut session = Session::new(board, image, &motor, seed)?;
    session.machine.set_fill(match arguments.fill {
        Fill::Words => bus::Fill::WordByWord,
        Fill::Once => bus::Fill::AtOnce,
    });
    Ok(session)
}

/// Several boards on one CAN, each with a motor of its own, and an adapter to it.
fn together(arguments: &Arguments) -> Result<ExitCode> {
    static ENDED: AtomicBool = AtomicBool::new(false);
    let board = |(index, name): (usize, &String)| {
        at_power_on(arguments, &firmware::board(name)?, arguments.seed + index as u64)
    };
    let boards = arguments.boards.iter().enumerate().map(board).collect::<Result<Vec<_>>>()?;
    let make = if arguments.calibrated { Bus::calibrated } else { Bus::new };
    let mut bus = make(boards, vec![Adapter::station()])?;
    let mut adapter =
        arguments.serial.as_deref().map(|description| Adapter::open(description, arguments.wait)).transpose()?;
    let end_s = arguments.seconds.unwrap_or(if adapter.is_some() { f64::INFINITY } else { 1.0 });
    ctrlc::set_handler(|| ENDED.store(true, Relaxed))?;
    let typed = arguments.typed.then(Typed::listen);
    let (start, mut shown) = (Instant::now(), vec![0; bus.boards.len()]);
    while bus.seconds() < end_s && !ENDED.load(Relaxed) {
        typed.iter().try_for_each(|typed| typed.happen(&mut bus.boards[0]))?;
        if let Some(adapter) = &mut adapter {
            let now_s = bus.seconds();
            adapter.serve(&mut bus.stations[0], now_s);
            if !adapter.may_run(bus.seconds(), start.elapsed()) {
                std::thread::sleep(LOOK);
                continue;
            }
        }
        bus.step()?;
        for (index, board) in bus.boards.iter().enumerate() {
            board.lines[shown[index]..].iter().for_each(|line| println!("{:2} {}", index + 1, show(line)));
            shown[index] = board.lines.len();
        }
    }
    let mut wrong = false;
    for (index, board) in bus.boards.iter().enumerate() {
        let verdict = Outcome::of(board).verdict();
        verdict.iter().for_each(|what| println!("{:2} {what}", index + 1));
        wrong |= !verdict.is_empty();
    }
    let share = 100.0 * bus.wire.busy_s / bus.seconds();
    println!("{} frames, {} error frames, the bus was busy for {share:.1} %", bus.wire.frames, bus.wire.errors);
    Ok(if wrong { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Runs to the end or until Ctrl-C, shows the log, and serves who is at the serial port.
fn run(session: &mut Session, end_s: f64, arguments: &Arguments, mut line: Option<Line>) -> Result<()> {
    static ENDED: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| ENDED.store(true, Relaxed))?;
    let bar = bar(end_s)?;
    let typed = arguments.typed.then(Typed::listen);
    let (start, mut shown, mut watches) = (Instant::now(), 0, false);
    while session.seconds() < end_s && !ENDED.load(Relaxed) {
        typed.iter().try_for_each(|typed| typed.happen(session))?;
        if let Some(line) = &mut line {
            line.hear(session);
            line.send(&[], session.seconds());
            if !line.may_run(session.seconds(), start.elapsed()) {
                std::thread::sleep(LOOK);
                continue;
            }
        }
        if !watches && session.seconds() >= arguments.watch {
            watches = true;
            session.watch_control();
        }
        let sent = session.slice(end_s)?;
        if let Some(line) = &mut line {
            line.send(&sent, session.seconds());
        }
        for line in &session.lines[shown..] {
            // Standard output, so that the log can be piped.
            bar.suspend(|| println!("{}", show(line)));
        }
        shown = session.lines.len();
        bar.set_position((session.seconds() * 1e3) as u64);
    }
    bar.finish_and_clear();
    let (virtual_s, real_s) = (session.seconds(), start.elapsed().as_secs_f64());
    eprintln!("{virtual_s:.3} s of the board in {real_s:.1} s: {:.2} s a minute", 60.0 * virtual_s / real_s);
    Ok(())
}

fn bar(end_s: f64) -> Result<ProgressBar> {
    let (length, template) = if end_s.is_finite() {
        (Some((end_s * 1e3) as u64), "{wide_bar} {pos} of {len} ms, {eta} left")
    } else {
        (None, "{spinner} {pos} ms")
    };
    let bar = ProgressBar::with_draw_target(length, indicatif::ProgressDrawTarget::stderr_with_hz(5));
    bar.set_style(ProgressStyle::with_template(template)?);
    Ok(bar)
}

fn show(line: &LogLine) -> String {
    let place = if line.place.is_empty() { String::new() } else { format!(" ({})", line.place) };
    format!("{:12.6} {:6} {}{place}", line.at_ns as f64 * 1e-9, line.level, line.message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(arguments: &[&str]) -> Result<Arguments, clap::Error> {
        Arguments::try_parse_from([&["cargo virtual", "board"], arguments].concat())
    }

    #[test]
    fn only_a_time_that_passes_is_run() {
        for text in ["nan", "inf", "0", "-1", "1e30", "", "1,5", "2s"] {
            assert!(parse(&["--seconds", text]).is_err(), "{text}");
        }
        assert!(parse(&["--seconds", "0.5", "--two-halls"]).is_ok_and(|found| found.two_halls == Some(90.0)));
        assert!(parse(&["--two-halls", "-120"]).is_ok());
        assert!(parse(&["--two-halls", "nan"]).is_err());
    }

    #[test]
    fn what_cannot_be_written_is_told_before_the_run() {
        let folder = std::env::temp_dir().join("no/such/folder/figures.json");
        let wrong = parse(&["--json", folder.to_str().unwrap()]).unwrap();
        assert!(make_room(&wrong).unwrap_err().to_string().contains("cannot write"));
        assert!(make_room(&parse(&["--out", "/dev/null"]).unwrap()).is_err());
    }
}
