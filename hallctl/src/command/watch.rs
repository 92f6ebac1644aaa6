//! `hallctl watch`: the drive, live. Of the Halls it shows how far each has swung, which is what mounting takes.

use crate::client::{Client, unexpected};
use crate::error::{Error, Result};
use crate::interrupt;
use crate::out::Out;
use crate::units::Units;
use crate::words;
use anyhow::{Context, anyhow};
use hallservo::hall::calibrate::report::SensorReport;
use hallservo::mode::Mode;
use hallservo_protocol::{Answer, Ask, Calibration, Status, Telemetry};
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Gauge, Paragraph, Sparkline, Wrap};
use std::collections::VecDeque;
use std::io::{IsTerminal, stdout};
use std::mem::forget;
use std::process::exit;
use std::thread;
use std::time::{Duration, Instant};

/// Frames a second.
const HZ: f32 = 50.0;
/// From picture to picture, on the wall.
const PICTURE: Duration = Duration::from_millis(50);
/// Speeds that are kept for the curve.
const KEPT: usize = 400;
/// Within it, who was sent a signal has put the terminal back and ended.
const GRACE: Duration = Duration::from_secs(2);
const KEYS: &str = " s or space: stop   r: forget the swings   q: end ";

/// What is shown.
struct View {
    board: String,
    units: Units,
    status: Status,
    frame: Telemetry,
    /// Smallest and largest code of each Hall since it was forgotten.
    seen: [Option<(u16, u16)>; 3],
    /// The same as calibrated, of those that there are, where this is known.
    calibrated: Vec<(f32, f32)>,
    /// Largest code.
    most: u16,
    speeds: VecDeque<f32>,
}

impl View {
    fn see(&mut self, frame: Telemetry) {
        self.frame = frame;
        for (seen, code) in self.seen.iter_mut().zip(frame.codes) {
            let (least, most) = seen.unwrap_or((code, code));
            *seen = Some((least.min(code), most.max(code)));
        }
        if self.speeds.len() == KEPT {
            self.speeds.pop_front();
        }
        self.speeds.push_back(frame.speed_rad_s);
    }
}

pub(super) fn watch(client: &mut Client, out: Out) -> Result<()> {
    if !stdout().is_terminal() {
        return Err(Error::Other(anyhow!("watch needs a terminal; `hallctl telemetry` and `status --json` need none")));
    }
    let mut view = begin(client, out.units)?;
    let mut terminal = ratatui::try_init().context("the terminal")?;
    end_without_terminal();
    let shown = show(client, &mut view, &mut terminal);
    if ratatui::try_restore().is_err() {
        // Of a terminal that is gone nothing can be put back, and its end would panic when it could not say so.
        forget(terminal);
    }
    client.carry_on();
    client.end_telemetry()?;
    shown
}

/// Of a terminal that is gone, the keyboard is read for ever: the port would never be free again.
fn end_without_terminal() {
    thread::spawn(|| {
        while !interrupt::came() {
            thread::sleep(PICTURE);
        }
        thread::sleep(GRACE);
        exit(interrupt::EXIT.into());
    });
}

fn begin(client: &mut Client, units: Units) -> Result<View> {
    let status = client.status()?;
    let bits = client.setting(Ask::Get("adc_bits"), |setting| setting.value as u32)?;
    client.order(Ask::Telemetry(HZ))?;
    Ok(View {
        board: client.identity().board.clone(),
        units,
        status,
        frame: Telemetry::default(),
        seen: [None; 3],
        calibrated: calibrated(client)?,
        most: ((1_u32 << bits.min(16)) - 1) as u16,
        speeds: VecDeque::new(),
    })
}

/// The range of each Hall by the calibration, if there was one since power-up.
fn calibrated(client: &mut Client) -> Result<Vec<(f32, f32)>> {
    client.ask(Ask::Calibration, |answer| match answer {
        Answer::Calibration(Calibration::Done(report)) => {
            let range =
                |sensor: &SensorReport| (sensor.offset - sensor.swing / 2.0, sensor.offset + sensor.swing / 2.0);
            Ok(report.present().iter().map(range).collect())
        }
        Answer::Calibration(_) => Ok(Vec::new()),
        other => unexpected(&other),
    })
}

fn show(client: &mut Client, view: &mut View, terminal: &mut ratatui::DefaultTerminal) -> Result<()> {
    loop {
        let before = view.status;
        view.status = client.status()?;
        if before.mode != view.status.mode {
            view.calibrated = calibrated(client)?;
        }
        let mut look = (Instant::now(), view.status.uptime_ms);
        client.pause(&mut look, &view.status, PICTURE)?;
        while let Some(frame) = client.telemetry() {
            view.see(frame);
        }
        if interrupt::came() {
            return Err(Error::Interrupted);
        }
        terminal.draw(|frame| draw(frame, view)).context("the terminal")?;
        while event::poll(Duration::ZERO).context("the keyboard")? {
            let Event::Key(key) = event::read().context("the keyboard")? else { continue };
            match pressed(&key) {
                Some(Key::End) => return Ok(()),
                Some(Key::Stop) => client.order(Ask::Disarm)?,
                Some(Key::Forget) => view.seen = [None; 3],
                None => {}
            }
        }
    }
}

enum Key {
    End,
    Stop,
    Forget,
}

fn pressed(key: &KeyEvent) -> Option<Key> {
    match key.code {
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Key::End),
        KeyCode::Char('q') | KeyCode::Esc => Some(Key::End),
        KeyCode::Char('s' | ' ') => Some(Key::Stop),
        KeyCode::Char('r') => Some(Key::Forget),
        _ => None,
    }
}

fn draw(frame: &mut Frame<'_>, view: &View) {
    let next = next(view);
    let height = 3 + lines(&next, usize::from(frame.area().width.saturating_sub(2)));
    let heights = [Constraint::Length(height), Constraint::Length(8), Constraint::Length(7), Constraint::Min(3)];
    let [head, halls, motion, curve] = Layout::vertical(heights).areas(frame.area());
    frame.render_widget(state(view, next), head);
    draw_halls(frame, view, halls);
    frame.render_widget(figures(view), motion);
    let least = view.speeds.iter().copied().fold(0.0, f32::min);
    let shifted: Vec<u64> = view.speeds.iter().map(|speed| (100.0 * (speed - least)) as u64).collect();
    let width = usize::from(curve.width.saturating_sub(2));
    let latest = &shifted[shifted.len().saturating_sub(width)..];
    frame.render_widget(Sparkline::default().data(latest).block(Block::bordered().title(" Speed ")), curve);
}

/// What to do about a fault, or what limits the drive.
fn next(view: &View) -> String {
    match view.status.mode {
        Mode::Faulted(fault) => words::what_to_do(fault),
        mode => match words::limits_in(mode, view.frame.limits) {
            limits if limits.is_empty() => String::new(),
            limits => format!("limited by {}", limits.join(", ")),
        },
    }
}

/// Lines of a text that is broken between words.
fn lines(text: &str, width: usize) -> u16 {
    let mut used = 0;
    1 + text
        .split(' ')
        .map(|word| word.chars().count())
        .filter(|&word| {
            let breaks = used > 0 && used + 1 + word > width;
            used = if breaks || used == 0 { word } else { used + 1 + word };
            breaks
        })
        .count() as u16
}

fn state(view: &View, next: String) -> Paragraph<'static> {
    let mode = view.status.mode;
    let colour = match mode {
        Mode::Faulted(_) => Color::Red,
        Mode::Running | Mode::Aligning | Mode::Calibrating => Color::Green,
        Mode::Ready | Mode::Unarmed => Color::Gray,
    };
    let bold = Style::default().fg(colour).add_modifier(Modifier::BOLD);
    let lines = vec![Line::from(Span::styled(words::mode(mode), bold)), Line::from(next)];
    let block = Block::bordered().title(format!(" {} ", view.board)).title_bottom(KEYS);
    Paragraph::new(lines).wrap(Wrap { trim: true }).block(block)
}

fn draw_halls(frame: &mut Frame<'_>, view: &View, area: Rect) {
    let block = Block::bordered().title(" Halls, of the ADC's range ");
    let rows = Layout::vertical([Constraint::Length(2); 3]).split(block.inner(area));
    frame.render_widget(block, area);
    for hall in 0..3 {
        let code = view.frame.codes[hall];
        let most = view.most.max(1);
        let at_end = code == 0 || code >= most;
        let swung = view.seen[hall].map_or_else(|| "-".into(), |(least, most)| format!("{least} … {most}"));
        let unused = hall >= view.calibrated.len() && !view.calibrated.is_empty();
        let wanted = match view.calibrated.get(hall) {
            Some((least, most)) => format!(", calibrated {least:.0} … {most:.0}"),
            None if unused => ", not used".into(),
            None => String::new(),
        };
        let label = format!("Hall {}: {code}, swung {swung}{wanted}", hall + 1);
        let gauge = Gauge::default()
            .ratio((f64::from(code) / f64::from(most)).min(1.0))
            .label(label)
            .gauge_style(Style::default().fg(if at_end && !unused { Color::Red } else { Color::Blue }));
        let [bar, _] = Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(rows[hall]);
        frame.render_widget(gauge, bar);
    }
}

fn figures(view: &View) -> Paragraph<'static> {
    let View { frame, status, units, .. } = view;
    let of = |value: f32, unit: &str| if value.is_nan() { "not measured".into() } else { format!("{value:.3} {unit}") };
    let [d, q] = frame.current_a;
    let [bridge, motor] = status.temperatures_c;
    let lines = [
        format!("angle     {:>8.1}° electrical", frame.angle_deg),
        format!("speed     {:<22} position  {}", units.speed(frame.speed_rad_s), units.position(frame.position_turns)),
        format!("current   {:<22} along d   {}", of(q, "A along q"), of(d, "A")),
        format!("bus       {:<22} bridge    {}", of(frame.bus_v, "V"), of(bridge, "°C")),
        format!("motor     {}", of(motor, "°C")),
    ];
    Paragraph::new(lines.map(Line::from).to_vec()).block(Block::bordered().title(" Motion "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hallservo::fault::Fault;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn screen(view: &View, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, view)).unwrap();
        terminal.backend().to_string()
    }

    fn view() -> View {
        View {
            board: "simulated".into(),
            units: Units::default(),
            status: Status { mode: Mode::Faulted(Fault::Stall), ..Status::default() },
            frame: Telemetry::default(),
            seen: [None; 3],
            calibrated: vec![(1800.0, 2300.0); 3],
            most: 4095,
            speeds: VecDeque::new(),
        }
    }

    #[test]
    fn of_two_halls_the_third_is_not_used() {
        let mut view = view();
        view.calibrated.pop();
        view.see(Telemetry { codes: [1900, 2000, 4095], ..Telemetry::default() });
        let screen = screen(&view, 80, 24);
        assert!(screen.contains("Hall 3: 4095, swung 4095 … 4095, not used"), "{screen}");
    }

    #[test]
    fn everything_is_on_the_screen() {
        let mut view = view();
        for code in [1900, 2100, 2000] {
            let current_a = [f32::NAN, 0.25];
            view.see(Telemetry { codes: [code, 0, 4095], speed_rad_s: 12.5, current_a, ..Telemetry::default() });
        }
        let screen = screen(&view, 80, 24);
        for part in [
            "faulted: the rotor does not turn at the largest current",
            "then `hallctl│\"\n\"│clear`",
            "Hall 1: 2000, swung 1900 … 2100, calibrated 1800 … 2300",
            "Hall 3: 4095",
            "12.50 rad/s",
            "0.250 A along q",
            "not measured",
            "s or space: stop",
        ] {
            assert!(screen.contains(part), "{part}: {screen}");
        }
    }

    #[test]
    fn no_screen_is_too_small() {
        let mut view = view();
        (0..1000).for_each(|k| view.see(Telemetry { speed_rad_s: k as f32, ..Telemetry::default() }));
        assert_eq!(view.speeds.len(), KEPT);
        for (width, height) in [(1, 1), (3, 30), (200, 4), (20, 10)] {
            screen(&view, width, height);
        }
    }
}
