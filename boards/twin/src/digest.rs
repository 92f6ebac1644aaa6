//! A running digest: FNV-1a, 64 bit, a word at a time.

/// Equal for equal sequences; different, but for one chance in 2⁶⁴, for others.
#[derive(Clone, Copy, Debug)]
pub struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Digest {
    /// Takes up more words.
    pub fn push(&mut self, words: &[u16]) {
        for &word in words {
            self.0 = (self.0 ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// The digest so far.
    pub fn value(&self) -> u64 {
        self.0
    }
}
