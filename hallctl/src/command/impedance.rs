//! A spring and a damper at the shaft.

use super::motion::{self, Target};
use crate::client::Client;
use crate::error::Result;
use crate::out::Out;
use crate::units::{self, Quantity};
use hallservo::control::impedance::{Motion, Request};

/// Where, how stiff and how strong.
#[derive(Clone, Debug, clap::Args)]
#[group(id = "impedance")]
pub(super) struct Options {
    /// Where the spring is at rest: 2.5, 2.5turns, 90deg, 3.1rad; without, where the rotor is
    #[arg(value_parser = units::position, conflicts_with_all = ["within", "velocity", "stop"])]
    position: Option<Quantity>,
    /// Stiffness, N·m/rad [default: by position_bandwidth_hz, speed_bandwidth_hz and inertia_kgm2]
    #[arg(long, value_name = "NM_RAD", value_parser = units::real)]
    kp: Option<f32>,
    /// Damping, N·m·s/rad [default: by speed_bandwidth_hz and inertia_kgm2]
    #[arg(long, value_name = "NMS_RAD", value_parser = units::real)]
    kd: Option<f32>,
    /// Feed-forward torque, N·m, or 50mNm
    #[arg(long, value_parser = units::torque)]
    torque: Option<Quantity>,
    /// Largest torque, N·m, or 50mNm [default: that of max_current_a]
    #[arg(long, value_parser = units::torque)]
    max_torque: Option<Quantity>,
    /// The spring's position moves with this speed: 100, 100rad/s, 1000rpm
    #[arg(long, value_parser = units::speed)]
    velocity: Option<Quantity>,
    /// … up to here
    #[arg(long, value_parser = units::position, requires = "velocity")]
    stop: Option<Quantity>,
    /// Largest speed on the way to the position [default: max_speed_rad_s]
    #[arg(long, value_parser = units::speed)]
    max_speed: Option<Quantity>,
    /// Largest acceleration of the spring's position, rad/s² [default: max_acceleration_rad_s2]
    #[arg(long, value_name = "RAD_S2")]
    max_acceleration: Option<f32>,
    /// Spring and damper outside of a range only
    #[arg(long, num_args = 2, value_names = ["LEAST", "MOST"], value_parser = units::position)]
    #[arg(conflicts_with_all = ["velocity", "stop", "max_speed", "max_acceleration"])]
    within: Option<Vec<Quantity>>,
    #[command(flatten)]
    options: motion::Options,
}

impl Options {
    fn request(&self, out: Out) -> Request {
        let turns = |quantity: Quantity| quantity.value(out.units.position.turns());
        let speed = |quantity: Quantity| quantity.value(out.units.speed.rad_s()) as f32;
        let torque = |quantity: Quantity| quantity.value(1.0) as f32;
        let motion = match self.within.as_deref() {
            Some([least, most, ..]) => {
                Motion::Within { least_turns: Some(turns(*least)), most_turns: Some(turns(*most)) }
            }
            _ => Motion::To {
                position_turns: self.position.map(turns),
                speed_rad_s: self.velocity.map_or(0.0, speed),
                stop_turns: self.stop.map(turns),
                max_speed_rad_s: self.max_speed.map(speed),
                max_acceleration_rad_s2: self.max_acceleration,
            },
        };
        Request {
            kp_nm_rad: self.kp,
            kd_nms_rad: self.kd,
            feed_forward_nm: self.torque.map_or(0.0, torque),
            max_torque_nm: self.max_torque.map(torque),
            motion,
            ..Request::default()
        }
    }
}

/// Commands it until its time is over.
pub(super) fn hold(client: &mut Client, options: &Options, out: Out) -> Result<()> {
    motion::hold(client, &options.options, Target::Impedance(options.request(out)), out)
}
