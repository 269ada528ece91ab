//! Turns the bytes of a fuzzer into numbers.

use glam::Vec3;

/// Takes numbers from the front of a byte slice. When it is used up, all numbers are zero.
pub struct Input<'a>(&'a [u8]);

/// How coordinates are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinates {
    /// Any bit pattern of an f32, including NaN, infinities, and subnormal numbers.
    Bits,
    /// One byte, a multiple of an eighth. Coincident points, parallel edges, and shared planes become common instead of
    /// improbable.
    Eighths,
    /// One byte, a multiple of an eighth, and one byte that moves it by a few units in the last place.
    NearEighths,
    /// Two bytes: a sign, an exponent from 2^-64 to 2^63, and three bits of fraction.
    Magnitudes,
}

impl<'a> Input<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn rest(&self) -> &'a [u8] {
        self.0
    }

    fn bytes<const COUNT: usize>(&mut self) -> [u8; COUNT] {
        let mut taken = [0; COUNT];
        let (front, rest) = self.0.split_at(COUNT.min(self.0.len()));
        taken[..front.len()].copy_from_slice(front);
        self.0 = rest;
        taken
    }

    pub fn byte(&mut self) -> u8 {
        self.bytes::<1>()[0]
    }

    /// A number below `end`, which is at most 256.
    pub fn below(&mut self, end: usize) -> usize {
        usize::from(self.byte()) % end
    }

    pub fn float(&mut self) -> f32 {
        f32::from_le_bytes(self.bytes())
    }

    pub fn coordinates(&mut self) -> Coordinates {
        [Coordinates::Bits, Coordinates::Eighths, Coordinates::NearEighths, Coordinates::Magnitudes][self.below(4)]
    }

    fn coordinate(&mut self, written: Coordinates) -> f32 {
        match written {
            Coordinates::Bits => self.float(),
            Coordinates::Eighths => f32::from(self.byte() as i8) / 8.0,
            Coordinates::NearEighths => {
                let eighths = f32::from(self.byte() as i8) / 8.0;
                let steps = i32::from(self.byte() as i8);
                f32::from_bits(eighths.to_bits().saturating_add_signed(steps / 16))
            }
            Coordinates::Magnitudes => {
                let [low, high] = self.bytes();
                let exponent = u32::from(low & 0x7f) + 127 - 64;
                f32::from_bits(u32::from(high >> 7) << 31 | exponent << 23 | u32::from(high & 0b111) << 20)
            }
        }
    }

    pub fn point(&mut self, written: Coordinates) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|_| self.coordinate(written)))
    }

    pub fn points(&mut self, count: usize, written: Coordinates) -> Vec<Vec3> {
        (0..count).map(|_| self.point(written)).collect()
    }
}
