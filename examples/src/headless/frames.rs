//! The range of frames of a recording that an example plays.

use std::{ops::Range, str::FromStr};

/// A range `A..B`, as typed. Either end may be missing.
#[derive(Clone, Copy, Debug)]
pub struct FrameRange {
    start: Option<usize>,
    end: Option<usize>,
}

#[derive(Debug, thiserror::Error)]
#[error("--frames {start}..{end}: expected at least one frame, within 0..{frames}")]
pub struct NoSuchFrames {
    start: usize,
    end: usize,
    frames: usize,
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (start, end) = text.split_once("..").ok_or("expected A..B, for example 0..10")?;
        let number = |text: &str| match text.trim() {
            "" => Ok(None),
            digits => digits.parse().map(Some).map_err(|_| format!("'{digits}' is not a frame number")),
        };
        Ok(Self { start: number(start)?, end: number(end)? })
    }
}

impl FrameRange {
    /// The range in a recording with `frames` frames.
    pub fn of(self, frames: usize) -> Result<Range<usize>, NoSuchFrames> {
        let range = self.start.unwrap_or(0)..self.end.unwrap_or(frames);
        if range.is_empty() || range.end > frames {
            return Err(NoSuchFrames { start: range.start, end: range.end, frames });
        }
        Ok(range)
    }
}
