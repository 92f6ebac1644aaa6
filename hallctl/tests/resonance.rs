//! `hallctl tune` and `hallctl chirp` at loads on shafts that twist: what swings is named, and the loops that are left
//! are calm.

use crate::process::{self, Drive};
use serde_json::Value;

/// A load, as the options of `hallctl simulate` have it.
#[derive(Clone, Copy)]
struct Load {
    times: f64,
    hz: f64,
    backlash_deg: f64,
}

impl Load {
    const fn new(times: f64, hz: f64) -> Self {
        Self { times, hz, backlash_deg: 0.0 }
    }

    fn antiresonance_hz(&self) -> f64 {
        self.hz / (1.0 + self.times).sqrt()
    }

    /// A drive with it, calibrated.
    fn drive(&self) -> Drive {
        let [times, hz, backlash] = [self.times, self.hz, self.backlash_deg].map(|number| number.to_string());
        let options = ["--load-inertia", &times, "--resonance-hz", &hz, "--backlash-deg", &backlash];
        let drive = Drive::start(&options);
        drive.ok(&["calibrate"]);
        drive
    }
}

fn json(drive: &Drive, arguments: &[&str]) -> Value {
    let text = drive.ok(&[&["--json"], arguments].concat());
    serde_json::from_str(text.lines().last().unwrap()).unwrap_or_else(|why| panic!("{why}: {text}"))
}

fn number(value: &Value, path: &str) -> f64 {
    value.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {value}"))
}

/// Both frequencies are those of the load.
fn is_named(found: &Value, load: &Load, within: f64) {
    for (name, expected) in [("resonance_hz", load.hz), ("antiresonance_hz", load.antiresonance_hz())] {
        let share = number(found, &format!("/load/resonance/{name}")) / expected;
        assert!((share - 1.0).abs() < within, "{name}: {expected} Hz, but {found}");
    }
}

/// Steps of position and speed settle, and at rest and in the end nothing swings: RMS of the speed, at most four times
/// that of the sensors alone; of the position, a thousandth of a turn.
fn is_calm(drive: &Drive) {
    // Armed once: the check at arming wants a load that does not swing any more.
    drive.ok(&["arm"]);
    let position = json(drive, &["step", "position", "0.3", "--seconds", "1"]);
    assert!(number(&position, "/measured/settling_s") < 0.6, "{position}");
    assert!(number(&position, "/measured/noise") < 1e-3, "{position}");
    for (size, from) in [("100", "25"), ("0.001", "0")] {
        let speed = json(drive, &["step", "speed", size, "--from", from, "--seconds", "1"]);
        assert!(number(&speed, "/measured/noise") < 2.0, "{speed}");
    }
}

/// The inertia is measured with the load, so that the loop is as fast as the settings say; the bandwidth which is set by
/// default howls then.
fn tuned(load: &Load) -> (Drive, Value) {
    let drive = load.drive();
    drive.ok(&["identify"]);
    let tuned = json(&drive, &["tune", "--keep"]);
    println!("{} times, {} Hz, play {}°: {} Hz", load.times, load.hz, load.backlash_deg, tuned["proposed_hz"]);
    (drive, tuned)
}

fn tuned_is_calm(load: &Load, within: f64) {
    let (drive, tuned) = tuned(load);
    is_named(&tuned["found"], load, within);
    let proposed = number(&tuned, "/proposed_hz");
    // It has said what howls, and is well below.
    assert!(proposed <= 0.51 * number(&tuned, "/swings_from_hz"), "{tuned}");
    let kept = number(&json(&drive, &["settings", "get", "speed_bandwidth_hz"]), "/value");
    assert!((kept - proposed).abs() < 1e-3, "{kept}, not {proposed}");
    is_calm(&drive);
}

/// A heavy load, one as heavy as the rotor, and a very heavy one, of which the short form leaves out the second.
#[test]
fn a_load_on_a_soft_shaft_is_calm_after_tuning() {
    for load in [Load::new(3.0, 85.0), Load::new(1.2, 140.0), Load::new(6.0, 110.0)].iter().step_by(sim::of(2, 1)) {
        tuned_is_calm(load, 0.05);
    }
}

/// Play makes the spring softer.
#[test]
fn a_load_with_play_is_calm_after_tuning() {
    tuned_is_calm(&Load { backlash_deg: 0.7, ..Load::new(2.0, 120.0) }, 0.2);
}

/// With the inertia of the rotor alone the loop is slow and overshoots at any bandwidth: that is said, and nothing is
/// made worse.
#[test]
fn an_inertia_that_is_not_the_settings_is_said() {
    let load = Load::new(3.0, 125.0);
    let drive = load.drive();
    let chirped = json(&drive, &["chirp", "speed"]);
    is_named(&chirped["found"], &load, 0.05);
    assert!((number(&chirped, "/found/load/inertia") / 4.0 - 1.0).abs() < 0.15, "{}", chirped["found"]);
    let said = drive.ok(&["tune", "--keep"]);
    assert!(said.contains("times the inertia of the setting inertia_kgm2: `hallctl identify`"), "{said}");
    assert!(said.contains("resonance") && said.contains("anti-resonance"), "{said}");
    is_calm(&drive);
}

/// One that turns hard from pole to pole answers small steps as a heavier one would: no reason to doubt what was measured.
#[test]
fn a_light_rotor_that_cogs_is_not_told_another_inertia() {
    let (drive, folder) = (Drive::start(&["--motor", "22-pairs", "--seed", "2"]), tempfile::tempdir().unwrap());
    let journal = folder.path().join("commission.toml");
    let said = drive.ok(&["commission", "--max-current", "30", "--yes", "--file", journal.to_str().unwrap()]);
    drive.ok(&["arm"]);
    for said in [said, drive.ok(&["chirp", "speed"]), drive.ok(&["chirp", "speed"])] {
        assert!(!said.contains("times the inertia"), "{said}");
    }
}

#[test]
fn chirp_says_that_a_loop_howls() {
    let drive = Load::new(3.0, 110.0).drive();
    drive.ok(&["identify"]);
    let said = drive.ok(&["chirp", "speed"]);
    assert!(said.contains("The loop swings by itself") && said.contains("`hallctl tune`"), "{said}");
    assert!(!said.contains("--steps"), "{said}");
}

/// Nothing is made up.
#[test]
fn a_stiff_shaft_has_no_resonance() {
    let drive = Drive::start(&[]);
    drive.ok(&["calibrate"]);
    for arguments in [&["chirp", "speed"][..], &["tune"]] {
        let found = json(&drive, arguments)["found"].clone();
        assert!(found["load"]["resonance"].is_null() && found["swings_a"].is_null(), "{arguments:?}: {found}");
        let inertia = number(&found, "/load/inertia");
        assert!((0.85..1.15).contains(&inertia), "{arguments:?}: {found}");
    }
}

#[test]
fn a_drive_that_cannot_be_is_refused_in_words() {
    for (options, said) in [
        (&["--load-inertia", "0"][..], "--load-inertia"),
        (&["--load-inertia", "3", "--resonance-hz", "9e9"], "1 to 5000"),
        (&["--load-inertia", "3", "--load-damping=-1"], "--load-damping"),
        (&["--load-inertia", "3", "--backlash-deg", "nan"], "degrees"),
        (&["--resonance-hz", "50"], "--load-inertia"),
        (&["--encoder", "37/37"], "look alike 37 times in a turn"),
        (&["--encoder", "36/45"], "multiples of 3"),
        (&["--two-halls", "0"], "20 to 160 electrical degrees"),
        (&["--two-halls=-nan"], "20 to 160 electrical degrees"),
        (&["--coil-field", "1e9"], "from 0 to 1"),
        (&["--uneven=-1"], "from 0 to 5"),
        (&["--fault", "bus--5V@0s"], "a supply has 0V or more"),
        (&["--flash", "/dev/zero"], "/dev/zero is not a file"),
    ] {
        let output = std::process::Command::new(process::HALLCTL).arg("simulate").args(options).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!([Some(1), Some(2)].contains(&output.status.code()) && text.contains(said), "{options:?}: {text}");
    }
}

/// Uneven magnets make the speed of a rotor without any load swing: no shaft is blamed for it, and with a map the loop is
/// faster.
#[test]
fn uneven_magnets_are_no_shaft_that_twists() {
    for uneven in ["1", "0.5"].into_iter().take(sim::of(1, 2)) {
        let drive = Drive::start(&["--seed", "2", "--uneven", uneven]);
        drive.ok(&["calibrate"]);
        let said = drive.ok(&["tune"]);
        assert!(said.contains("The magnets are uneven") && said.contains("`hallctl magnets learn`"), "{said}");
        assert!(!said.contains("shaft twists") && !said.contains("play between"), "{said}");
        drive.ok(&["magnets", "learn"]);
        let tuned = json(&drive, &["tune"]);
        assert!(tuned["uneven_magnets"] == false && tuned["found"]["load"]["resonance"].is_null(), "{tuned}");
        assert!(number(&tuned, "/proposed_hz") >= 60.0, "{tuned}");
    }
}

/// To learn them once more would not help: a wrong number of pole pairs makes a map of no rotor.
#[test]
fn magnets_that_are_uneven_with_a_map_are_not_to_be_learnt_once_more() {
    let drive = Drive::start(&["--uneven", "1"]);
    drive.ok(&["settings", "set", "pole_pairs", "3"]);
    drive.ok(&["calibrate"]);
    drive.ok(&["magnets", "learn"]);
    let said = drive.ok(&["tune"]);
    assert!(said.contains("`hallctl pole-pairs`") && said.contains("a map of them is in use"), "{said}");
}

#[test]
fn a_simulated_drive_says_what_is_unusual_about_it() {
    for (options, words) in [
        (&[][..], &[][..]),
        (&["--two-halls", "45"], &["two Halls, 45° apart", "settings set halls 2"]),
        (&["--encoder", "37/36"], &["rings of 37 and 36 pole pairs", "0.05 mm"]),
        (&["--motor", "paper", "--uneven", "1"], &["paper", "uneven"]),
    ] {
        let drive = crate::process::Drive::start(options);
        assert_eq!(drive.about.is_empty(), words.is_empty(), "{options:?}: {}", drive.about);
        for word in words {
            assert!(drive.about.contains(word), "{options:?}: {}", drive.about);
        }
    }
}
