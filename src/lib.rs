//! hallservo
#![no_std]

pub mod angle;
pub mod trig;

    pub mod estimate {}
}
