//! Figures in prose that nobody measured: what is bought, wired and set, what others print, what a sum of two lines
//! gives. Each stands here as the page says it, with the reason why it needs no source.

use super::page::Pages;

/// Page, where its figures come from, and the figures.
const GIVEN: &[(&str, &str, &[&str])] = &[
    ("SAFETY.md", "physics", &["wrong by less than 90°"]),
    (
        "SAFETY.md",
        "1/64 of the boards' full scales",
        &["0.05 A on the IHM16M1", "0.5 A on the IHM08M1", "0.9 A on the ESC1"],
    ),
    ("docs/numbers.md", "(1 + s)/(1 − s), s = 0.25 of tests/weakening.rs", &["0.67 to 1.67 times"]),
    (
        "docs/numbers.md",
        "conditions of the test of late Halls, and 1450 rad/s · 7 · 50 µs",
        &["25 and 50 µs", "50 µs late, which the settings do not say (29°", "motor of 2 mH", "told as 1.7 mH"],
    ),
    ("SAFETY.md", "LARGEST_TRIM of src/drive/field_oriented.rs", &["off by more than 30°"]),
    ("boards/README.md", "a period of 40 kHz", &["a control period, 25 µs"]),
    (
        "boards/README.md",
        "what a decision was worth when it was taken: history, with the tool that tells it",
        &[
            "takes 16 KB more",
            "spares 10 668 bytes",
            "takes 9 KB more",
            "8 KB; outlining",
            "saves 28 bytes",
            "268 bytes were left",
        ],
    ),
    ("boards/README.md", "the timers of an emulated chip, in src/time.rs of its folder", &["to 128 000 instructions"]),
    ("boards/README.md", "data sheets", &["boards with 128 KiB", "at 5 Mbit/s"]),
    (
        "boards/b-g431b-esc1/README.md",
        "parts and data sheets",
        &[
            "three 3 mΩ shunts",
            "3.3 V",
            "below 5 kΩ",
            "the Hall connector's 5 V",
            "default motor's 0.36 mH",
            "amplifiers of 60 A",
            "see 1.7 mV/A on a bias of 129 mV",
        ],
    ),
    (
        "boards/b-g431b-esc1/README.md",
        "half a period's step along a sine, by hand",
        &["At 1000 Hz electrical that leaves 0.03 % of its amplitude, of 0.37 %"],
    ),
    (
        "boards/b-g431b-esc1/README.md",
        "what to set, and what to look for",
        &["0.1 A at 15 V", "below 50 mA", "within 3 %", "limited to 1 A"],
    ),
    (
        "boards/nucleo-g431rb-ihm16m1/README.md",
        "parts and data sheets",
        &["1.5 A RMS, 7 to 45 V", "0 Ω in place of R11 (39 kΩ)", "(10 kΩ each)", "3.3 V", "below 5 kΩ", "gives 5 V"],
    ),
    (
        "boards/nucleo-g431rb-ihm16m1/README.md",
        "what to set, and what to look for",
        &["0.1 A at 12 V", "within 3 %", "by 100 Ω", "limited to 0.5 A"],
    ),
    (
        "boards/nucleo-g474re-ihm08m1/README.md",
        "parts and data sheets",
        &["10 to 48 V", "3.3 V", "below 2 kΩ", "10 nF at each pin", "more than 12 V", "below 3.2 kΩ"],
    ),
    ("boards/nucleo-g474re-ihm08m1/README.md", "by formula, beside them", &["1 mm here", "every 0.22 mm"]),
    (
        "boards/nucleo-g474re-ihm08m1/README.md",
        "the ADCs' clock and the sequences of src/constants.rs",
        &["sampled for 576 ns", "0.3 µs after the valley for ring 1 and 0.9 µs", "comes 0.6 µs later"],
    ),
    (
        "boards/nucleo-g474re-ihm08m1/README.md",
        "what to set, and what to look for",
        &["0.05 mm off the axis", "0.1 A at 12 V", "below 50 mA", "within 3 %", "by 100 Ω", "limited to 1 A"],
    ),
    ("boards/b-g431b-esc1/README.md", "the table above it", &["better off with 20 kHz"]),
    (
        "docs/hardware.md",
        "what may be set, and what a test is done with",
        &[
            "Below 20 kHz it would",
            "and at 80 kHz a loop of 2500 Hz",
            "two rings keeps its 40 kHz",
            "at 20 and at 80 kHz in simulation as at 40 kHz",
        ],
    ),
    ("docs/porting.md", "an example", &["in time at 80 kHz"]),
    (
        "docs/building.md",
        "what to buy, and where to put it",
        &[
            "30 mV/mT for 20 to 40 mT",
            "120° or 60° electrical apart",
            "mechanical 120° or 60° divided",
            "with 4 pole pairs 30° or 15°, or 120°",
            "Halls: 3.3 V",
            "100 nF between supply",
            "limited to 0.1 A",
            "limited to 1 A",
            "At 2 % of it",
        ],
    ),
    (
        "docs/can.md",
        "data sheets and CAN's own rules",
        &[
            "A transceiver for 5 Mbit/s whose logic takes 3.3 V",
            "with 5 V for the bus",
            "120 Ω",
            "60 Ω with the power off",
            "128 KiB of flash",
            "good to 1 % from 0 to 85 °C",
            "11 or 29 bits",
            "129 times eleven",
        ],
    ),
    ("docs/can.md", "worked out of the bit rates of the table above it", &["up to 1.3 µs", "together 2.6 %"]),
    (
        "docs/features.md",
        "what is allowed, and what it says",
        &["near 60° or 120°", "Hall 1 is 36°", "Two Halls, 90°, 120° or 60°"],
    ),
    (
        "docs/building.md",
        "what is allowed; of two sensors at ψ the noise is 1/sin ψ over √(2/3) of three",
        &["90°, 120° or 60° apart, `hallctl", "up to 1.4 times as noisy (least at 90°", "90° apart a fifth harmonic"],
    ),
    (
        "docs/features.md",
        "the motors of `hallctl simulate --motor`, in sim/src/motors.rs",
        &["from 20 mΩ and 8 µH to 20 Ω and 10 mH"],
    ),
    ("docs/first-motor.md", "what to set", &["supply at 15 V"]),
    ("docs/hardware.md", "data sheets", &["(1.5 A: the safest"]),
    (
        "docs/hardware.md",
        "physics: 50 nC · 40 kHz · 10 Ω / (1 µs / 25 µs)",
        &["with 50 nC, 40 kHz and 10 Ω, 1 µs of 25 costs 0.5 V", "driver of 100 Ω", "it would be 5 V"],
    ),
    (
        "docs/numbers.md",
        "conditions of tests/long_vectors.rs",
        &["(`least_low_side_s` 1 µs", "amplifiers that take 4 µs", "a dead time of 0.8 µs", "by up to 40 codes"],
    ),
    ("docs/impedance.md", "every eighth period of 40 kHz", &["0.2 ms apart"]),
    ("docs/impedance.md", "an example", &["with 20 mN·m and may move the shaft by 0.1 rad wants 0.2 N·m/rad"]),
    (
        "docs/moteus-tools.md",
        "bytes by the linker when it was added, of no promise",
        &["2 KiB of RAM, and 81 KiB of flash"],
    ),
    (
        "docs/numbers.md",
        "how the simulated motors and encoders are made, and what is done to them",
        &[
            "up to 8°, amplitudes off by up to 30 %, offsets by up to 10 %, 5 % third harmonic, 1 % noise",
            "a swing of 500 codes of a 12-bit ADC",
            "8° placement, ±30 % amplitude, ±10 % offset, 5 % third harmonic, 1 % noise, 12 bit, 10 Hz electrical",
            "1000 samples a second",
            "field-oriented, 100 rad/s",
            "differ by ±20 %",
            "If it is 2 %",
            "with 2° first and second harmonic in each head, 0.05 mm of eccentricity, opposite heads up to 1° off",
            "±1 LSB of noise",
            "±5 % of speed",
            "rings 0.05 mm off",
            "four 12-bit heads",
        ],
    ),
    ("docs/numbers.md", "bytes by the linker when it was added, of no promise", &["another 4 KiB"]),
    (
        "docs/numbers.md",
        "what the experiment sets",
        &[
            "do not see it alike (±20 % in size, ±15° in direction)",
            "the field at the largest current 5 % of the magnets'",
        ],
    ),
    (
        "docs/numbers.md",
        "conditions of hallctl/tests/magnets.rs",
        &["by a turn at 1 rad/s", "Halls 60 °C warmer or 45 °C colder"],
    ),
    (
        "docs/numbers.md",
        "SLOWEST_UNEVEN_HZ of app/src/adaptation.rs, and what was seen without it",
        &[
            "from 32 Hz electrical on: slower, it bent a mapped angle by up to 0.9°, at a quarter of the unevenness and 1 rad/s",
        ],
    ),
    ("docs/numbers.md", "in print", &["a mean error of 0.073 rad mechanical, which is 16.7°"]),
    (
        "docs/numbers.md",
        "geometry: 360° / 37, and half of it over 4 pole pairs",
        &["as 9.7° electrical", "by up to 1.2°"],
    ),
    ("docs/porting.md", "bytes by the linker when it was changed, of no promise", &["13 KiB of RAM, 45 KiB of flash"]),
    ("docs/porting.md", "what to set, and what records need", &["some 100 mA", "blocks of 2 KiB"]),
    ("docs/protocol.md", "an example, which a test encodes", &["Turn at −1.5 rad/s"]),
    ("docs/tool.md", "data sheets", &["boards of 128 KiB"]),
    ("emulator/README.md", "Arm's and ST's manuals, and CAN's own rules", &["any frame at 1 Mbit/s", "1 to 3 cycles"]),
    ("emulator/README.md", "of the machine that it runs on", &["30 to 40 s of a board's time"]),
    ("emulator/README.md", "a period of 40 kHz", &["25 µs", "40 kHz"]),
];

/// They are figures, and nothing is given that no page says.
pub fn check(pages: &Pages) {
    for (page, _, figures) in GIVEN {
        for figure in *figures {
            pages.give(page, figure);
        }
    }
}
