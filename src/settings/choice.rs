//! Settings that are one of a few.

/// Parts of the local current feedback with block and sinusoidal commutation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Feedback {
    /// Proportional, as in the paper.
    P,
    /// With an integral part, which leaves no error at rest.
    #[default]
    Pi,
    /// With a derivative part, which makes up for half of the loop's delay.
    Pd,
    /// All three.
    Pid,
}

/// What a drive does that gets no command for too long.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OnTimeout {
    /// A fault: bridge off.
    #[default]
    Fault,
    /// Brakes to rest under speed control and stays there.
    Stop,
}

/// What a drive does whose motor has not come to rest in time after a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OnStopFailure {
    /// A fault: bridge off, the rotor coasts.
    #[default]
    Off,
    /// The windings are shorted, which brakes a turning rotor, as long again; then the bridge is switched off. The
    /// current is limited by nothing but resistance and inductance.
    Brake,
}
