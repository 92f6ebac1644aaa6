//! Repeats on the host the run that an emulated chip logged on standard input, and compares to the bit.

use anyhow::{Context, Result, bail, ensure};
use hallservo::drive::{Channels, Command};
use hallservo::hall::estimate::Estimator;
use hallservo::mode::Mode;
use hallservo::service::{Event, Service};
use std::io::{BufRead, stdin};
use twin::Twin;
use twin::log::{Entry, What};

fn main() -> Result<()> {
    let mut entries = Vec::new();
    for line in stdin().lock().lines() {
        let line = line?;
        match line.parse::<Entry>() {
            Ok(entry) => entries.push(entry),
            Err(_) => println!("{line}"),
        }
    }
    entries.sort_by_key(|entry| entry.period);
    let mut host = Host::new()?;
    let mut digests = 0;
    for entry in &entries {
        host.run_to(entry.period);
        match entry.what {
            What::Digest(digest) => {
                host.compare(digest)?;
                digests += 1;
            }
            What::Install => host.install()?,
            What::Calibrate => host.send(Command::Calibrate)?,
            What::Arm => host.send(Command::Arm)?,
            What::Drive(modulation) => host.send(Command::Drive(modulation))?,
            What::Disarm => host.send(Command::Disarm)?,
        }
    }
    ensure!(digests > 1, "the chip logged no digests");
    println!("on the host: {}", host.twin.figures());
    println!("chip and host agree in every bit of {} periods ({digests} digests)", host.twin.periods());
    Ok(())
}

/// The run again.
struct Host {
    twin: Twin,
    service: Service,
    /// The calibration is complete, and waits for the period in which the chip had fitted it.
    fitting: bool,
    agreed: u32,
}

impl Host {
    fn new() -> Result<Self> {
        let config = twin::settings().validate()?;
        let (interrupt, tasks) = Box::leak(Box::new(Channels::new())).split();
        let estimators = [(); 2].map(|()| Box::leak(Box::new(Estimator::blank())));
        let twin = Twin::new(config, interrupt).context("the plant refuses its parameters")?;
        Ok(Self { twin, service: Service::new(config, tasks, estimators), fitting: false, agreed: 0 })
    }

    fn run_to(&mut self, period: u32) {
        while self.twin.periods() < period {
            let calibrating = self.twin.drive().mode() == Mode::Calibrating;
            let sample = self.twin.sample();
            let output = self.twin.drive().step(&sample);
            self.twin.actuate(&sample, &output);
            // The last record of a calibration makes the service fit, which the chip did later.
            self.fitting |= calibrating && self.twin.drive().mode() != Mode::Calibrating;
            if !self.fitting {
                while self.service.poll().is_some() {}
            }
        }
    }

    fn install(&mut self) -> Result<()> {
        self.fitting = false;
        while let Some(event) = self.service.poll() {
            match event {
                Event::Calibrated(_) => return Ok(()),
                Event::Refused(error) => return Err(error.into()),
                Event::Reply(_) | Event::Installed(_) | Event::Record(_) => {}
            }
        }
        bail!("the chip was calibrated in period {}, the host not", self.twin.periods())
    }

    fn send(&mut self, command: Command) -> Result<()> {
        Ok(self.service.send(command)?)
    }

    fn compare(&mut self, digest: u64) -> Result<()> {
        let period = self.twin.periods();
        ensure!(
            digest == self.twin.digest(),
            "chip and host differ between the periods {} and {period}: digest {digest:#x} on the chip, {:#x} here",
            self.agreed,
            self.twin.digest()
        );
        self.agreed = period;
        Ok(())
    }
}
