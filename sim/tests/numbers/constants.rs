//! Figures that the code sets: the constant, and where a page says it.

use super::page::Figure::Is;
use super::page::{Pages, read};
use super::text::Narrow;

const HARDWARE: &str = "docs/hardware.md";
const SETTINGS: &str = "src/settings/declaration.rs";

/// Page and its words, file and its words, and how many of the page's unit one of the code's is.
const CONSTANTS: &[(&str, &str, &str, &str, f64)] = &[
    (SAFETY, "by more than {}° (mechanical)", KIND, "MOST_WRONG: (f64, f64) = ({}", 1.0),
    (SAFETY, "or for more than {} ms", KIND, "MOST_WRONG: (f64, f64) = (30.0, {})", 1e3),
    (SAFETY, "R and L off by up to {} %", BENCH, "motor.inductance_h *= random.random_range(0.75..1.{})", 1.0),
    (SAFETY, "flux linkage by {} %", BENCH, "flux_linkage_vs *= random.random_range(0.85..1.{})", 1.0),
    (
        NUMBERS,
        "between −20 and {} °C",
        "sim/src/experiment/endurance/life.rs",
        "TEMPERATURES_C: [f64; 2] = [-20.0, {}]",
        1.0,
    ),
    (NUMBERS, "Resistance is off by up to {} %", WEAKENING, "Unlike { resistance: 1.{}, inductance: 1.3", 1.0),
    (NUMBERS, "inductance by {} %, flux", WEAKENING, "resistance: 1.25, inductance: 1.{}", 10.0),
    (NUMBERS, "flux linkage by {} %, the inductance", WEAKENING, "Unlike { flux: 1.0{}", 1.0),
    (SAFETY, "V where {} V are the limit", "src/settings/declaration.rs", "over_voltage_v: f32 = {}", 1.0),
    (SAFETY, "come to rest within {} turns", "tests/mounted_mass.rs", "AWAY: f64 = {}", 1.0),
    (SAFETY, "differs by more than {} % from the calibrated", "src/hall/pair.rs", "HEALTHY: f32 = {}", 100.0),
    (BOARDS, "every {} periods", "boards/twin/src/lib.rs", "CHECKPOINT: u32 = {}", 1.0),
    (BOARDS, "The watchdog, {} ms", WATCHDOG, "const MILLISECONDS: u32 = {}", 1.0),
    (BOARDS, "The window watchdog, {} µs", WINDOW, "10 of them are {} µs", 1.0),
    (BOARDS, "It has {} ms", WINDOW, "10 of them are {} µs", 128e-3),
    (EMULATOR, "off after {} µs at most", WINDOW, "10 of them are {} µs", 1.0),
    (EMULATOR, "same error within {} %", "emulator/virtual/tests/angle.rs", "(ratio - 1.0).abs() < {}", 100.0),
    (EMULATOR, "in the {} ms for which", "emulator/virtual/tests/boards/line.rs", "stand still for up to {} ms", 1.0),
    (BOARDS, "firmware has to leave {} bytes", CHECK, "left=({}", 1.0),
    (BOARDS, "of flash and {} bytes of RAM", CHECK, "left=(10900 {})", 1.0),
    ("docs/tool.md", "The shaft turns by up to {}°", "tests/arming.rs", "FARTHEST_DEG: f64 = {}", 1.0),
    ("docs/tool.md", "which takes up to {} s", "tests/arming.rs", "LONGEST_S: f64 = {}", 1.0),
    ("docs/tool.md", "up to {}° in at most", "tests/arming.rs", "FARTHEST_CARRIED_DEG: f64 = {}", 1.0),
    ("docs/tool.md", "in at most {} s where strong cogging", "tests/arming.rs", "LONGEST_CARRIED_S: f64 = {}", 1.0),
    (CAN, "is obeyed within {} ms", STOP_TEST, "OFF_S: f64 = {}", 1e3),
    ("docs/moteus-tools.md", "obeyed within {} ms", STOP_TEST, "OFF_S: f64 = {}", 1e3),
    (ESC1, "control at {} kHz", ESC1_CODE, "PWM_HZ: u32 = {}", 1e-3),
    (ESC1, "Hall 1 is held {} ns", "boards/b-g431b-esc1/src/registers.rs", "ADC cycles early: {} ns", 1.0),
    (ESC1, "{} ns between the edges", ESC1_CODE, "dead_time_ns: {}", 1.0),
    (ESC1, "conduct {} µs of each period", ESC1_CODE, "sampling_window_s = {}", 1e6),
    (IHM16, "Control at {} kHz", IHM16_CODE, "PWM_HZ: u32 = {}", 1e-3),
    (IHM16, "Hall 1 is held {} ns", "boards/nucleo-g431rb-ihm16m1/src/registers.rs", "ADC cycles early: {} ns", 1.0),
    (IHM16, "{} ns between the edges", IHM16_CODE, "dead_time_ns: {}", 1.0),
    (IHM08, "| 80 kHz | {} kHz, the default", IHM08_CODE, "PWM_HZ: u32 = {}", 1e-3),
    (IHM08, "another one of 20 to {} kHz", IHM08_CODE, "(\"pwm_hz\", {})", 1e-3),
    (ESC1, "another one of 20 to {} kHz", ESC1_CODE, "PWM_HZ: u32 = {}", 1e-3),
    (HARDWARE, "the control runs at {} kHz", IHM08_CODE, "PWM_HZ: u32 = {}", 1e-3),
    (HARDWARE, "may be set to | 20 to {} kHz", IHM08_CODE, "(\"pwm_hz\", {})", 1e-3),
    (HARDWARE, "may be set to | {} to", SETTINGS, "pwm_hz: f32 = 40e3, {} =>", 1e-3),
    (IHM08, "{} ns between the edges", IHM08_CODE, "dead_time_ns: {}", 1.0),
    (IHM08, "beyond {}° it refuses", "app/src/encoder/vernier.rs", "TOLERANCE_DEG: f32 = {}", 1.0),
    (ESC1, "| dead time | {} ns", ESC1_CODE, "dead_time_ns: {}", 1.0),
    (ESC1, "| ceilings | {} A", ESC1_CODE, "(\"max_current_a\", {})", 1.0),
    (ESC1, "over-current {} A,", ESC1_CODE, "(\"over_current_a\", {})", 1.0),
    (ESC1, "{} °C at the thermistor", ESC1_CODE, "(\"bridge_max_c\", {})", 1.0),
    (ESC1, "full scale; under {} V", ESC1_CODE, "under_voltage_v: {}", 1.0),
    (ESC1, "and over {} V are faults", ESC1_CODE, "over_voltage_v: {}", 1.0),
    (IHM16, "| dead time | {} ns", IHM16_CODE, "dead_time_ns: {}", 1.0),
    (IHM16, "| ceilings | {} A", IHM16_CODE, "(\"max_current_a\", {})", 1.0),
    (IHM16, "over-current {} A,", IHM16_CODE, "(\"over_current_a\", {})", 1.0),
    (IHM16, "{} °C at the thermistor", IHM16_CODE, "(\"bridge_max_c\", {})", 1.0),
    (IHM16, "full scale; under {} V", IHM16_CODE, "under_voltage_v: {}", 1.0),
    (IHM16, "and over {} V are faults", IHM16_CODE, "over_voltage_v: {}", 1.0),
    (IHM08, "| dead time | {} ns", IHM08_CODE, "dead_time_ns: {}", 1.0),
    (IHM08, "| ceilings | {} A", IHM08_CODE, "(\"max_current_a\", {})", 1.0),
    (IHM08, "over-current {} A,", IHM08_CODE, "(\"over_current_a\", {})", 1.0),
    (IHM08, "{} °C at the thermistor", IHM08_CODE, "(\"bridge_max_c\", {})", 1.0),
    (IHM08, "full scale; under {} V", IHM08_CODE, "under_voltage_v: {}", 1.0),
    (IHM08, "and over {} V are faults", IHM08_CODE, "over_voltage_v: {}", 1.0),
    (BUILDING, "below {} the calibration says so", REPORT, "(self.swing < {})", 1.0),
    (BUILDING, "below {} it refuses", REPORT, "swing) => swing < {}", 1.0),
    (BUILDING, "From {}° electrical", REPORT, "(degrees > {})", 1.0),
    (BUILDING, "from {}° on it refuses", REPORT, "Misplaced(_, degrees) => degrees > {}", 1.0),
    (BUILDING, "A swing of {} codes", "plant/src/parameters.rs", "The nominal swing is {} LSB", 1.0),
    (PROTOCOL, "over a UART ({} baud", "boards/stm32g4/src/chip/line.rs", "BAUD: u32 = {}", 1.0),
    ("docs/porting.md", "Serial line**: {} baud", "boards/stm32g4/src/chip/line.rs", "BAUD: u32 = {}", 1.0),
    ("docs/impedance.md", "A torque fades towards {} times", "src/control/config.rs", "torque_ends: ({} * speed)", 1.0),
    (CAN, "nobody took for {} ms", "boards/stm32g4/src/chip/can.rs", "PATIENCE: u32 = {}", 1.0),
    (PROTOCOL, "A message has at most {} bytes", "protocol/src/lib.rs", "MESSAGE: usize = {}", 1.0),
    ("docs/moteus-clients.md", "A reply** has {} bytes", "registers/src/lib.rs", "FRAME: usize = {}", 1.0),
    ("docs/moteus-clients.md", "longer than {} s", "src/control/impedance/request.rs", "LONGEST_S: f32 = {}", 1.0),
    (
        "docs/numbers.md",
        "Beyond {} % in the mean of the three the filter",
        "src/hall/adapt/doubt.rs",
        "to be learnt: {} % RMS",
        1.0,
    ),
    ("docs/numbers.md", "one of them {} % weaker", LEARNING, "fades in [0.0, {}]", 100.0),
    ("docs/numbers.md", "up to {} s after arming", LEARNING, "[0, 100, 300, {}].map", 1e-3),
    ("docs/numbers.md", "at {}° RMS of the angle or better", LEARNING, "worst_deg < {}", 1.0),
    (EMULATOR, "each request is worth {} ms", "emulator/virtual/src/serial.rs", "WORTH_S: f64 = {}", 1e3),
    (EMULATOR, "in steps of {} µs", "emulator/chip/src/can/wire.rs", "STEP_S: f64 = {}", 1e6),
    (EMULATOR, "a period and {} µs", "emulator/virtual/tests/boards/faults.rs", "REACTION_S: f64 = {}", 1e6),
    (EMULATOR, "`watchdog.rs`, {} ms", WATCHDOG, "const MILLISECONDS: u32 = {}", 1.0),
    (
        EMULATOR,
        "places the second {}° from the first",
        "emulator/virtual/src/main.rs",
        "default_missing_value = \"{}\"",
        1.0,
    ),
    (EMULATOR, "the port's {} bytes", "boards/stm32g4/src/chip/line.rs", "ROOM: usize = {}", 1.0),
];

const SAFETY: &str = "SAFETY.md";
const LEARNING: &str = "hallctl/tests/learning.rs";
const KIND: &str = "sim/src/experiment/faults/kind.rs";
const NUMBERS: &str = "docs/numbers.md";
const WEAKENING: &str = "tests/weakening.rs";
const BENCH: &str = "sim/src/experiment/faults/bench.rs";
const BOARDS: &str = "boards/README.md";
const WINDOW: &str = "boards/stm32g4/src/registers/watchdog.rs";
const CHECK: &str = "boards/check";
const CAN: &str = "docs/can.md";
const STOP_TEST: &str = "emulator/virtual/tests/stop.rs";
const WATCHDOG: &str = "boards/stm32g4/src/chip/watchdog.rs";
const ESC1: &str = "boards/b-g431b-esc1/README.md";
const ESC1_CODE: &str = "boards/b-g431b-esc1/src/constants.rs";
const IHM16: &str = "boards/nucleo-g431rb-ihm16m1/README.md";
const IHM16_CODE: &str = "boards/nucleo-g431rb-ihm16m1/src/constants.rs";
const IHM08: &str = "boards/nucleo-g474re-ihm08m1/README.md";
const IHM08_CODE: &str = "boards/nucleo-g474re-ihm08m1/src/constants.rs";
const BUILDING: &str = "docs/building.md";
const REPORT: &str = "src/hall/calibrate/report.rs";
const PROTOCOL: &str = "docs/protocol.md";
const EMULATOR: &str = "emulator/README.md";

pub fn check(pages: &Pages) {
    for (page, said, file, there, unit) in CONSTANTS {
        let code = Narrow::new(&read(file));
        match code.find(there).first().map(|(_, figures)| figures.clone()).as_deref() {
            Some([constant]) => pages.quote(page, said, &[Is(constant.value * unit)]),
            _ => pages.wrong(format!("{file} has no {there:?}, of which {page} says {said:?}")),
        }
    }
}
