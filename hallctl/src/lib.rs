//! hallctl
