//! Pseudo-random numbers that are the same on every platform.

/// The generator `SplitMix64` of Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators" (2014).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Creates the sequence of a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^ (bits >> 31)
    }

    /// A number from 0 to 1, excluding 1.
    pub fn unit(&mut self) -> f64 {
        // 53 bits fill the fraction of an f64 exactly.
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number from -1 to 1, excluding 1.
    pub fn signed_unit(&mut self) -> f32 {
        // 24 bits fill the fraction of an f32 exactly.
        (self.bits() >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    }

    /// An integer below `end`, which is at least 1.
    pub const fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }
}
