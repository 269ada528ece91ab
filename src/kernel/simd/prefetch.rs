//! Asks for what is to be read or written soon.
//!
//! A list of pairs says long before which triangles will be looked up. The processor sees only as far as the instructions
//! it has taken in, less than one block of eight pairs: so the loops over pairs ask some blocks ahead, and find everything
//! in the cache. Memory that is to be written has to be there, too: where a loop writes fast, it asks for the lines that come
//! some records later. Measured on `cloth_ball_92`: contacts of caps and of balls take 0.73 of the time without, overlap of caps
//! 0.81.

#![expect(
    clippy::inline_always,
    reason = "one instruction, in functions that are compiled for several instruction sets"
)]

use super::lanes::WIDTH;

/// How many blocks ahead: one takes less time than a line from the third cache, but not much.
const AHEAD: usize = 3;

/// How many records ahead of the last one memory is asked for. Records come faster than the processor foresees where they
/// go: measured on `cloth_ball_92`, contacts of balls take 0.8 of the time without, those of caps 0.9.
const WRITTEN_AHEAD: u32 = 32;

/// Bytes of a line of the cache.
const LINE: usize = 64;

/// What is read of the triangles of one side of pairs.
pub(in crate::kernel) trait Prefetch {
    /// Asks for what is to be read of a triangle soon.
    fn prefetch(&self, triangle: u32);
}

/// Of pairs that are worked on in blocks of eight, asks at the beginning of a block for what is to be read of a later one.
#[inline(always)]
pub(in crate::kernel) fn ask_ahead(a: &impl Prefetch, b: &impl Prefetch, pairs: &[[u32; 2]], block: usize) {
    let start = ((block + AHEAD) * WIDTH).min(pairs.len());
    // The last few are not worth a loop of their own.
    if let Some(block) = pairs[start..].first_chunk::<WIDTH>() {
        for &[triangle_a, triangle_b] in block {
            a.prefetch(triangle_a);
            b.prefetch(triangle_b);
        }
    }
}

/// Asks for the memory that a later block of pairs is to be appended to.
#[inline(always)]
pub(in crate::kernel) fn ask_for_room<T>(list: &mut Vec<T>) {
    let room = list.spare_capacity_mut();
    for place in (WRITTEN_AHEAD..WRITTEN_AHEAD + WIDTH as u32).step_by((LINE / size_of::<T>()).max(1)) {
        prefetch(room, place);
    }
}

/// Brings all lines of an item of a list into the cache, where the platform has an instruction for it.
#[inline(always)]
pub(in crate::kernel) fn prefetch_whole<T>(list: &[T], place: usize) {
    if let Some(item) = list.get(place) {
        for line in 0..size_of::<T>().div_ceil(LINE) {
            let lines = (&raw const *item).cast::<[u8; LINE]>();
            prefetch_address(lines.wrapping_add(line));
        }
    }
}

/// Brings an item of a list into the cache, where the platform has an instruction for it. Beyond the end it changes nothing.
#[inline(always)]
pub(in crate::kernel) fn prefetch<T>(list: &[T], place: u32) {
    prefetch_address(list.as_ptr().wrapping_add(place as usize));
}

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "the instruction takes a pointer")]
#[inline(always)]
fn prefetch_address<T>(address: *const T) {
    use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};

    // SAFETY: the instruction is part of every x86-64 and reads nothing that a program can see, whatever the address.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
}

#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn prefetch_address<T>(_: *const T) {}
