//! Soon.
use super::Common;
use anyhow::Result;
/// Soon.
pub fn main(_: &Common) -> Result<()> {
    Ok(())
}
