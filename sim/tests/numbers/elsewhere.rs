//! Tables that have figures of another kind: what is wired or set, or what another check compares.

use super::page::{Pages, exists};

/// Pages and headings (all, where there is none), and what the figures are, or which file makes them and bounds them.
const ELSEWHERE: &[(&str, &str, &str)] = &[
    ("ARCHITECTURE.md", "Who runs when, and who may call whom", "names"),
    ("SAFETY.md", "Promises", "tests/safety.rs"),
    ("boards/b-g431b-esc1/README.md", "Wiring", "boards/b-g431b-esc1/virtual.toml"),
    ("boards/b-g431b-esc1/README.md", "What the firmware sets", "boards/b-g431b-esc1/src/registers.rs"),
    ("boards/b-g431b-esc1/README.md", "The switching frequency", "worked out by hand"),
    ("boards/nucleo-g431rb-ihm16m1/README.md", "Wiring", "boards/nucleo-g431rb-ihm16m1/virtual.toml"),
    (
        "boards/nucleo-g431rb-ihm16m1/README.md",
        "What the firmware sets",
        "boards/nucleo-g431rb-ihm16m1/src/registers.rs",
    ),
    ("boards/nucleo-g431rb-ihm16m1/README.md", "What is verified, and what is assumed", "parts and pins"),
    ("boards/nucleo-g474re-ihm08m1/README.md", "Wiring", "boards/nucleo-g474re-ihm08m1/virtual.toml"),
    (
        "boards/nucleo-g474re-ihm08m1/README.md",
        "What the firmware sets",
        "boards/nucleo-g474re-ihm08m1/src/registers.rs",
    ),
    ("boards/nucleo-g474re-ihm08m1/README.md", "Two rings on the shaft", "boards/nucleo-g474re-ihm08m1/virtual.toml"),
    ("boards/PORTING.md", "1. The folder", "names"),
    ("boards/README.md", "hallservo on a chip", "names"),
    ("boards/README.md", "The boards with an STM32G4", "what steps were worth when they were done: history"),
    ("docs/building.md", "What to buy", "parts"),
    ("docs/can.md", "Wiring", "boards/nucleo-g474re-ihm08m1/virtual.toml"),
    ("docs/can.md", "Bit rates", "boards/stm32g4/src/registers"),
    ("docs/can.md", "Identifiers", "bits of an identifier"),
    ("docs/faults.md", "", "hallctl/tests/docs.rs"),
    ("docs/glossary.md", "", "units and ranges"),
    // The rows above the cycles', beside what sim/tests/numbers/constants.rs compares.
    ("docs/hardware.md", "The switching frequency", "boards/nucleo-g474re-ihm08m1/src/registers.rs"),
    ("docs/hardware.md", "Longer voltage vectors", "boards/nucleo-g474re-ihm08m1/src/registers.rs"),
    ("docs/moteus-clients.md", "Modes", "registers/tests/hostile.rs"),
    ("docs/moteus-clients.md", "ROS 2", "registers that others' sources name"),
    ("docs/moteus-clients.md", "Registers", "registers/tests/hostile.rs"),
    ("docs/moteus-tools.md", "Telemetry", "names"),
    ("docs/protocol.md", "", "hallctl/tests/docs.rs"),
    ("emulator/README.md", "What breaks, and how fast the bridge is off", "emulator/virtual/tests/boards/faults.rs"),
];

pub fn is(page: &str, heading: &str) -> bool {
    ELSEWHERE.iter().any(|(of, under, _)| *of == page && (under.is_empty() || *under == heading))
}

/// Nothing is excused that is not there.
pub fn check(pages: &Pages) {
    for (page, heading, what) in ELSEWHERE {
        if !pages.has_figures_under(page, heading) {
            pages.wrong(format!("{page} has no table of figures under {heading:?}"));
        }
        if what.contains('/') && !exists(what) {
            pages.wrong(format!("{page}, {heading}: there is no {what}"));
        }
    }
}
