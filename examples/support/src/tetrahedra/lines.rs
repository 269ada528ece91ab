//! The lines of a text file with their numbers, and the numbers on them.

use std::{path::Path, slice::Split, str::FromStr};

use super::TetrahedralMeshError;

/// Longest word that an error message quotes.
const LONGEST_QUOTE: usize = 40;

/// The lines of a file that are not blank.
pub(super) struct Lines<'a> {
    lines: Split<'a, u8, fn(&u8) -> bool>,
    name: &'a Path,
    /// Begins a comment, which lasts to the end of the line.
    comment: Option<u8>,
    /// The number of the last line that was read.
    number: usize,
    bytes: usize,
}

/// The words of one line.
pub(super) struct Line<'a> {
    text: &'a [u8],
    name: &'a Path,
    pub(super) number: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8], name: &'a Path, comment: Option<u8>) -> Self {
        let is_end: fn(&u8) -> bool = |&byte| byte == b'\n';
        Self { lines: bytes.split(is_end), name, comment, number: 0, bytes: bytes.len() }
    }

    /// The next line that is not blank.
    pub(super) fn next(&mut self) -> Option<Line<'a>> {
        loop {
            let text = self.lines.next()?;
            self.number += 1;
            let is_comment = |byte: &u8| Some(*byte) == self.comment;
            let text = text.split(is_comment).next().unwrap_or_default().trim_ascii();
            if !text.is_empty() {
                return Some(Line { text, name: self.name, number: self.number });
            }
        }
    }

    /// The next line, where the file must not end before it.
    pub(super) fn expect(&mut self, wanted: &str) -> Result<Line<'a>, TetrahedralMeshError> {
        self.next().ok_or_else(|| TetrahedralMeshError::EndsEarly {
            file: self.name.to_path_buf(),
            line: self.number,
            wanted: wanted.to_owned(),
        })
    }

    /// A capacity for `count` announced elements that the file can hold.
    pub(super) fn capacity(&self, count: u64) -> usize {
        /// The digit and the line break of the shortest line.
        const SHORTEST: usize = 2;
        usize::try_from(count).unwrap_or(usize::MAX).min(self.bytes / SHORTEST)
    }
}

impl<'a> Line<'a> {
    /// The line without spaces at its ends.
    pub(super) fn text(&self) -> &'a [u8] {
        self.text
    }

    pub(super) fn words(&self) -> Words<'a> {
        Words { rest: self.text, name: self.name, number: self.number }
    }

    pub(super) fn error(&self, detail: impl Into<String>) -> TetrahedralMeshError {
        TetrahedralMeshError::line(self.name, self.number, detail)
    }

    /// The beginning of the line, to quote.
    pub(super) fn quote(&self) -> String {
        quote(self.text)
    }
}

pub(super) struct Words<'a> {
    rest: &'a [u8],
    name: &'a Path,
    number: usize,
}

impl Words<'_> {
    /// The next word as a number. `wanted` names it in the error.
    pub(super) fn number<T: FromStr>(&mut self, wanted: &str) -> Result<T, TetrahedralMeshError> {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| {
            let found =
                if word.is_empty() { "the line ends".to_owned() } else { format!("`{}` was found", quote(word)) };
            self.error(format!("{wanted} was expected, but {found}"))
        })
    }

    /// Three finite coordinates.
    pub(super) fn position(&mut self) -> Result<[f32; 3], TetrahedralMeshError> {
        let mut position = [0.0_f32; 3];
        for coordinate in &mut position {
            *coordinate = self.number("a coordinate")?;
        }
        if position.iter().all(|coordinate| coordinate.is_finite()) {
            Ok(position)
        } else {
            Err(self.error("a coordinate is not finite in single precision"))
        }
    }

    /// The number of words left.
    pub(super) fn count(&self) -> usize {
        self.rest.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count()
    }

    pub(super) fn error(&self, detail: impl Into<String>) -> TetrahedralMeshError {
        TetrahedralMeshError::line(self.name, self.number, detail)
    }
}

fn quote(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(LONGEST_QUOTE)]).into_owned()
}
