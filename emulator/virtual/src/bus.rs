//! Several boards on one CAN. They go on in steps that are shorter than any frame, one board after the other, and then
//! the wire is settled: what happens depends neither on their order nor on the machine that computes it.

use crate::script;
use crate::session::Session;
use anyhow::{Result, ensure};
use chip::can::station::Station;
use chip::can::wire::{Node, STEP_S, Wire};

/// Longest time until a board has calibrated.
const CALIBRATED_S: f64 = 15.0;

/// The boards, and who else is on the wire.
pub struct Bus {
    /// In the order of their identifiers.
    pub boards: Vec<Session>,
    /// Adapters and others.
    pub stations: Vec<Station>,
    /// The wire.
    pub wire: Wire,
    now_s: f64,
}

impl Bus {
    /// Boards at power-on. They get the identifiers 1, 2, 3, … by their serial ports when they have started.
    ///
    /// # Errors
    /// None, unless the words for it have changed.
    pub fn new(mut boards: Vec<Session>, stations: Vec<Station>) -> Result<Bus> {
        for (index, board) in boards.iter_mut().enumerate() {
            board.share_wire();
            board.follow(script::parse(&format!("at 30ms send set bus_id {}", index + 1))?);
        }
        Ok(Bus { boards, stations, wire: Wire::default(), now_s: 0.0 })
    }

    /// The same of boards that calibrate first, each alone.
    ///
    /// # Errors
    /// As [`Session::slice`], or a calibration that does not succeed.
    pub fn calibrated(mut boards: Vec<Session>, stations: Vec<Station>) -> Result<Bus> {
        for (index, board) in boards.iter_mut().enumerate() {
            board.follow(script::parse("at 30ms send calibrate")?);
            board.run_until(0.1)?;
            while !says(board, &["activity: None", "calibrated: true"]) {
                ensure!(board.seconds() < CALIBRATED_S, "board {} has not calibrated", index + 1);
                board.follow(script::parse("at 0s send status")?);
                board.run_until(board.seconds() + 0.1)?;
            }
            board.follow(script::parse(&format!("at 0s send set bus_id {}\nat 0s send release", index + 1))?);
            board.run_until(board.seconds() + 0.3)?;
        }
        Ok(Self::of_running(boards, stations))
    }

    /// Boards that have run alone so far, together from here on; the latest says when.
    pub fn of_running(mut boards: Vec<Session>, stations: Vec<Station>) -> Bus {
        boards.iter_mut().for_each(Session::share_wire);
        let now_s = boards.iter().map(Session::seconds).fold(0.0, f64::max);
        Bus { boards, stations, wire: Wire::default(), now_s }
    }

    /// Time since power-on, seconds.
    pub fn seconds(&self) -> f64 {
        self.now_s
    }

    /// A step of all.
    ///
    /// # Errors
    /// As [`Session::slice`].
    pub fn step(&mut self) -> Result<()> {
        self.now_s += STEP_S;
        for board in &mut self.boards {
            board.run_until(self.now_s)?;
        }
        let mut nodes: Vec<&mut dyn Node> = Vec::with_capacity(self.boards.len() + self.stations.len());
        nodes.extend(self.boards.iter_mut().map(|board| board.machine.system.can() as &mut dyn Node));
        nodes.extend(self.stations.iter_mut().map(|station| station as &mut dyn Node));
        self.wire.settle(&mut nodes, self.now_s);
        Ok(())
    }

    /// Runs on for some seconds.
    ///
    /// # Errors
    /// As [`Session::slice`].
    pub fn run(&mut self, seconds: f64) -> Result<()> {
        let end_s = self.now_s + seconds;
        while self.now_s < end_s {
            self.step()?;
        }
        Ok(())
    }
}

/// Whether the last reply has all these words.
fn says(board: &Session, words: &[&str]) -> bool {
    let last = board.lines.iter().rfind(|line| line.level == "REPLY");
    last.is_some_and(|line| words.iter().all(|word| line.message.contains(word)))
}
