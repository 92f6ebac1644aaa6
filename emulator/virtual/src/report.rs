//! The report, as text and as HTML with plots.

use crate::angle::{AngleError, AngleErrors};
use crate::outcome::{Handler, Longest, Outcome, Part};
use anyhow::Result;
use chip::Trace;
use measure::Range;
use plots::{Plot, Report, Series};

/// Heading and rows of a table; the first row is its head.
pub struct Section {
    /// Heading.
    pub title: &'static str,
    /// Rows of cells.
    pub rows: Vec<Vec<String>>,
}

fn range(range: Range, unit: &str) -> String {
    if range.count == 0 {
        "—".into()
    } else if range.max - range.min < 0.5 {
        format!("{:.0} {unit}", range.max)
    } else {
        format!("{:.0} to {:.0} {unit}", range.min, range.max)
    }
}

fn row<const N: usize>(cells: [String; N]) -> Vec<String> {
    cells.into()
}

fn head<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(String::from).into()
}

/// Everything but log and traces.
pub fn sections(outcome: &Outcome) -> Vec<Section> {
    let mut sections = vec![
        Section { title: "Run", rows: run(outcome) },
        Section { title: "Clocks", rows: clocks(outcome) },
        Section { title: "Motor timer", rows: timer(outcome) },
        Section { title: "Legs, measured at the pins", rows: legs(outcome) },
        Section { title: "Sampling, from the valley of the PWM", rows: sampling(outcome) },
        Section { title: "Handlers", rows: handlers(outcome) },
        Section { title: "Control interrupt, own cycles", rows: control(outcome) },
        Section { title: "Control interrupt, in the mean by function", rows: parts(&outcome.parts) },
        Section { title: "Control interrupt, the longest period by function", rows: longest(outcome) },
        Section { title: "Bridge enabled (MOE)", rows: moe(outcome) },
        Section { title: "Brake resistor", rows: brake(outcome) },
    ];
    let events = outcome.facts.events.iter().map(|(at_s, what)| row([format!("{at_s:.6} s"), what.clone()]));
    sections.push(Section { title: "Events", rows: std::iter::once(head(["when", "what"])).chain(events).collect() });
    let wrong = outcome.verdict().into_iter().map(|what| row([what]));
    sections.push(Section { title: "Wrong", rows: std::iter::once(head(["what"])).chain(wrong).collect() });
    sections.retain(|section| section.rows.len() > 1);
    sections
}

fn run(outcome: &Outcome) -> Vec<Vec<String>> {
    let facts = &outcome.facts;
    let mut rows = vec![
        head(["figure", "value"]),
        row(["board".into(), outcome.board.clone()]),
        row(["time".into(), format!("{:.3} s", outcome.seconds)]),
        row(["instructions".into(), format!("{:.1} million", outcome.instructions as f64 / 1e6)]),
        row(["core busy".into(), format!("{:.1} %", 100.0 * outcome.load)]),
        row(["triggers of the ADC".into(), facts.triggers.to_string()]),
        row(["missed triggers".into(), facts.missed_triggers.to_string()]),
        row(["sequences never read".into(), facts.unread_sequences.to_string()]),
        row(["flash operations".into(), facts.flash_operations.to_string()]),
        row(["resets".into(), outcome.resets.len().to_string()]),
    ];
    if let Some(stack) = outcome.stack {
        rows.push(row(["stack used".into(), format!("{} of {} bytes", stack.used, stack.size)]));
    }
    if let Some(AngleErrors { constant_speed, transients }) = outcome.angle_error {
        for (when, error) in [("at constant speed", constant_speed), ("in transients", transients)] {
            let Some(AngleError { mean_deg, rms_deg, max_deg, count }) = error else { continue };
            let text = format!("{rms_deg:.3}° RMS, {max_deg:.2}° at most, about {mean_deg:+.3}°; {count} frames");
            rows.push(row([format!("error of the electrical angle {when}"), text]));
        }
    }
    if let Some(watchdog) = &facts.watchdog {
        let Range { min, max, count } = watchdog.interval_s;
        rows.push(row([
            "watchdog".into(),
            format!("{:.1} ms, bit {} times", watchdog.timeout_s * 1e3, watchdog.bites),
        ]));
        if count > 0 {
            rows.push(row(["fed after".into(), format!("{:.2} to {:.2} ms", min * 1e3, max * 1e3)]));
        }
    }
    if let Some(watchdog) = &facts.window_watchdog {
        let text = format!(
            "refreshed after {:.1} % of its time at most, bit {} times",
            watchdog.used.max * 1e2,
            watchdog.bites
        );
        rows.push(row(["window watchdog".into(), text]));
    }
    for (name, value) in &facts.motor {
        rows.push(row([motor_figure(name), format!("{value:.4}")]));
    }
    rows
}

/// A figure of the motor in words, with its unit: `current_u_a`.
fn motor_figure(name: &str) -> String {
    const UNITS: [(&str, &str); 6] =
        [("_rad_s", "rad/s"), ("_rad", "rad"), ("_turns", "turns"), ("_nm", "N·m"), ("_a", "A"), ("_v", "V")];
    let found = UNITS.iter().find_map(|(end, unit)| name.strip_suffix(end).map(|words| (words, *unit)));
    let (words, unit) = found.unwrap_or((name, "1"));
    format!("motor at the end: {} / {unit}", words.replace('_', " "))
}

fn clocks(outcome: &Outcome) -> Vec<Vec<String>> {
    let clocks =
        outcome.facts.clocks.iter().map(|clock| row([clock.name.clone(), format!("{:.6} MHz", clock.hz / 1e6)]));
    std::iter::once(head(["clock", "frequency"])).chain(clocks).collect()
}

fn timer(outcome: &Outcome) -> Vec<Vec<String>> {
    let mut rows = vec![head(["figure", "value"])];
    if let Some(pwm) = &outcome.facts.pwm {
        rows.extend([
            row(["PWM".into(), format!("{:.1} Hz, {}, {} ticks", pwm.hz, pwm.mode, pwm.reload)]),
            row(["dead time asked for".into(), format!("{:.0} ns", pwm.dead_time_ns)]),
            row(["outputs while off".into(), pwm.off_state.clone()]),
            row(["break inputs".into(), pwm.breaks.join(", ")]),
        ]);
    }
    rows
}

fn legs(outcome: &Outcome) -> Vec<Vec<String>> {
    let legs = outcome.facts.legs.iter().map(|leg| {
        row([
            leg.pins.join(", "),
            leg.timer_on_level.join(", "),
            leg.driver_on_level.join(", "),
            range(leg.dead_time_rising_ns, "ns"),
            range(leg.dead_time_falling_ns, "ns"),
            leg.shoot_through.to_string(),
        ])
    });
    let head =
        head(["pins", "on by the timer", "on at the driver", "dead time rising", "dead time falling", "shoot-through"]);
    std::iter::once(head).chain(legs).collect()
}

fn sampling(outcome: &Outcome) -> Vec<Vec<String>> {
    let rows = outcome.facts.sampling.iter().map(|one| {
        row([
            format!("{} rank {}", one.adc, one.rank),
            format!("{} (channel {})", one.signal, one.channel),
            one.trigger.clone(),
            range(one.trigger_ns, "ns"),
            range(one.start_ns, "ns"),
            range(one.held_ns, "ns"),
            range(one.end_ns, "ns"),
        ])
    });
    std::iter::once(head(["converter", "signal", "trigger", "at", "samples from", "until", "converted"]))
        .chain(rows)
        .collect()
}

fn handlers(outcome: &Outcome) -> Vec<Vec<String>> {
    let control = outcome.control.as_ref().map(|control| control.exception);
    let rows = outcome.handlers.iter().map(|handler| {
        let Handler { name, rate_hz, latency_ns, jitter_ns, after_trigger_ns, duration_ns, instructions, .. } = handler;
        row([
            if Some(handler.exception) == control { format!("{name} (control)") } else { name.clone() },
            format!("{rate_hz:.1} Hz"),
            range(*latency_ns, "ns"),
            format!("{jitter_ns:.0} ns"),
            range(*after_trigger_ns, "ns"),
            range(*duration_ns, "ns"),
            range(*instructions, ""),
        ])
    });
    let head = head(["handler", "rate", "latency", "jitter", "after the trigger", "duration", "own instructions"]);
    std::iter::once(head).chain(rows).collect()
}

/// How long the control interrupt took, and how often.
fn control(outcome: &Outcome) -> Vec<Vec<String>> {
    let Some(control) = &outcome.control else { return Vec::new() };
    let us = 1e6 / outcome.hclk_hz;
    let [mean, waited] = control.mean_cycles;
    let figure = |cycles: f64| format!("{cycles:.0} ({:.2} µs)", cycles * us);
    let mut rows = vec![
        head(["", "cycles"]),
        row(["mean".into(), figure(mean)]),
        row(["… of which waited for the flash".into(), figure(waited)]),
        row(["longest".into(), figure(control.cycles.max)]),
        row(["longest wait for the flash".into(), figure(control.waited.max)]),
    ];
    let all = control.histogram.values().sum::<u64>() as f64;
    for share in [0.5, 0.9, 0.99, 0.999, 0.9999] {
        let mut below = 0;
        let at = control.histogram.iter().find(|(_, count)| {
            below += **count;
            below as f64 >= share * all
        });
        if let Some((&from, _)) = at {
            rows.push(row([format!("{} % are below", share * 100.0), figure((from + cortex::BIN) as f64)]));
        }
    }
    // Ten rows at most, the rest of the histogram is in the figures.
    let step = (control.cycles.max as u64 / 10).next_multiple_of(cortex::BIN).max(cortex::BIN);
    for from in (0..=control.cycles.max as u64).step_by(step as usize) {
        let count: u64 = control.histogram.range(from..from + step).map(|(_, count)| count).sum();
        if count > 0 {
            rows.push(row([format!("{from} to {}", from + step), format!("{count} times")]));
        }
    }
    rows
}

/// Parts of the control interrupt of at least a cycle.
fn parts(parts: &[Part]) -> Vec<Vec<String>> {
    let rows = parts.iter().filter(|part| part.cycles >= 1.0).map(|part| {
        let figures = [part.instructions, part.cycles, part.waited].map(|figure| format!("{figure:.1}"));
        std::iter::once(part.function.clone()).chain(figures).collect()
    });
    std::iter::once(head(["function", "instructions", "cycles", "waited for the flash"])).chain(rows).collect()
}

fn longest(outcome: &Outcome) -> Vec<Vec<String>> {
    let Some(Longest { at_s, cycles, waited, parts: of }) = &outcome.longest else { return Vec::new() };
    let mut rows = parts(of);
    rows.push(row([format!("all, at {at_s:.6} s"), String::new(), cycles.to_string(), waited.to_string()]));
    rows
}

fn moe(outcome: &Outcome) -> Vec<Vec<String>> {
    let edges =
        outcome.facts.moe.iter().map(|edge| {
            row([format!("{:.6} s", edge.at_s), if edge.on { "on" } else { "off" }.into(), edge.by.clone()])
        });
    std::iter::once(head(["when", "bridge", "by"])).chain(edges).collect()
}

fn brake(outcome: &Outcome) -> Vec<Vec<String>> {
    let edges = outcome.facts.brake.iter();
    let edges = edges.map(|(at_s, on)| row([format!("{at_s:.6} s"), if *on { "on" } else { "off" }.into()]));
    std::iter::once(head(["when", "resistor"])).chain(edges).collect()
}

/// The report for a terminal.
pub fn text(outcome: &Outcome) -> String {
    let mut text = String::new();
    for Section { title, rows } in sections(outcome) {
        text += &format!("\n{title}\n");
        let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
        let width =
            |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max();
        for row in &rows {
            let cells = (0..columns).filter_map(|column| {
                let cell = row.get(column)?;
                Some(format!("{cell:<width$}", width = width(column).unwrap_or(0)))
            });
            text += &format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end());
        }
    }
    text
}

/// The report with plots of the traces and the log, one file.
///
/// # Errors
/// A trace that cannot be plotted.
pub fn html(outcome: &Outcome, trace: &Trace) -> Result<String> {
    let mut report = Report::new(&format!("{} on a virtual chip", outcome.board));
    report.lead(
        "The firmware that would be flashed, on a simulated chip with a simulated motor at its pins: what the motor did, \
         what the chip was asked for, and what was wrong.",
    );
    for (title, columns) in [
        ("Angle", &["angle / turns"][..]),
        ("Speed", &["speed / rad/s"]),
        ("Phase currents", &["current U / A", "current V / A", "current W / A"]),
        ("Torque", &["torque / N m"]),
        ("Bus", &["bus / V"]),
        ("Bridge enabled (MOE)", &["MOE"]),
    ] {
        let series: Vec<_> = columns.iter().filter_map(|name| series(trace, name)).collect();
        if !series.is_empty() {
            report.plot(&marked(Plot::new(title, "time / s", columns[0], series), outcome), "")?;
        }
    }
    for Section { title, rows } in sections(outcome) {
        report.heading(title).table(&rows);
    }
    let lines = outcome.log.iter().map(|line| {
        row([
            format!("{:.6} s", line.at_ns as f64 * 1e-9),
            line.level.clone(),
            line.message.clone(),
            line.place.clone(),
        ])
    });
    report
        .heading("Log")
        .table(&std::iter::once(head(["time", "level", "message", "place"])).chain(lines).collect::<Vec<_>>());
    Ok(report.html())
}

/// With marks where the drive's mode changed, which its log says as "Running after Ready".
fn marked(plot: Plot, outcome: &Outcome) -> Plot {
    let changes = outcome.log.iter().filter_map(|line| {
        let (mode, before) = line.message.split_once(" after ")?;
        (!mode.contains(' ') && !before.contains(' ')).then_some((line.at_ns, mode))
    });
    changes.fold(plot, |plot, (at_ns, mode)| plot.event(at_ns as f64 * 1e-9, mode))
}

fn series(trace: &Trace, name: &str) -> Option<Series> {
    let column = trace.names.iter().position(|known| known == name)?;
    (trace.rows.len() > 1).then(|| Series::new(name, trace.rows.iter().map(|row| (row[0], row[column]))))
}

/// The traces as comma-separated values.
pub fn csv(trace: &Trace) -> String {
    let mut text = trace.names.join(",") + "\n";
    for row in &trace.rows {
        text += &row.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}
