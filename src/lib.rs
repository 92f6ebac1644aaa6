//! hallservo
#![no_std]
