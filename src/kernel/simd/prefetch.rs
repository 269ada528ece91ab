//! Prefetches memory that will be read or written soon.
//!
//! A list of pairs names the triangles long before they are looked up. The processor only sees as far as the
//! instructions that it has taken in, which is less than one block of eight pairs. Loops over pairs therefore prefetch
//! some blocks ahead, and find everything in the cache. Memory that is to be written must be in the cache too, so loops
//! that write fast prefetch the lines some records ahead. Measured on `cloth_ball_92`: contacts of caps and of balls
//! take 0.73 of the time without prefetching, the overlap of caps 0.81.

use super::lanes::WIDTH;

/// How many blocks ahead to prefetch. One block takes less time than a cache line from L3, but not much less.
const AHEAD: usize = 3;

/// How many records past the end of a list to prefetch. Records are written faster than the processor predicts their
/// addresses. Measured on `cloth_ball_92`: contacts of balls take 0.8 of the time without prefetching, contacts of caps
/// 0.9.
const WRITTEN_AHEAD: u32 = 32;

/// Bytes per cache line.
const LINE: usize = 64;

/// Data that is read per triangle, for one side of the pairs.
pub(in crate::kernel) trait Prefetch {
    /// Prefetches the data of one triangle.
    fn prefetch(&self, triangle: u32);
}

/// Prefetches the data of a later block, for pairs that are processed in blocks of eight. Called at the start of each
/// block.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn ask_ahead(a: &impl Prefetch, b: &impl Prefetch, pairs: &[[u32; 2]], block: usize) {
    let start = ((block + AHEAD) * WIDTH).min(pairs.len());
    // The last partial block is not worth a loop of its own.
    if let Some(block) = pairs[start..].first_chunk::<WIDTH>() {
        for &[triangle_a, triangle_b] in block {
            a.prefetch(triangle_a);
            b.prefetch(triangle_b);
        }
    }
}

/// Prefetches the memory to which a later block of pairs will be appended.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn ask_for_room<T>(list: &mut Vec<T>) {
    let room = list.spare_capacity_mut();
    for place in (WRITTEN_AHEAD..WRITTEN_AHEAD + WIDTH as u32).step_by((LINE / size_of::<T>()).max(1)) {
        prefetch(room, place);
    }
}

/// Prefetches all cache lines of an item, if the platform has an instruction for it.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn prefetch_whole<T>(list: &[T], place: usize) {
    if let Some(item) = list.get(place) {
        for line in 0..size_of::<T>().div_ceil(LINE) {
            let lines = (&raw const *item).cast::<[u8; LINE]>();
            prefetch_address(lines.wrapping_add(line));
        }
    }
}

/// Prefetches an item, if the platform has an instruction for it. An index past the end has no effect.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn prefetch<T>(list: &[T], place: u32) {
    prefetch_address(list.as_ptr().wrapping_add(place as usize));
}

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "the intrinsic takes a raw pointer")]
#[cfg_attr(not(unoptimized), inline(always))]
fn prefetch_address<T>(address: *const T) {
    use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};

    // SAFETY: every x86-64 processor has this instruction, and it reads nothing that a program can observe, whatever
    // the address.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
}

#[cfg(not(target_arch = "x86_64"))]
#[cfg_attr(not(unoptimized), inline(always))]
fn prefetch_address<T>(_: *const T) {}
