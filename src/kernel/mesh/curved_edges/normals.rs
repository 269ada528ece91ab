//! The normals at the corners of triangles, which end at creases.

use glam::Vec3A;

use super::{faces::Face, selection::Selection};
use crate::kernel::{
    mesh::fans::{Fans, NONE, Slot},
    simd::parallel::Parallel,
};

/// Around a vertex with a crease and more faces than this, only those less than half as many steps away count.
const MOST_FACES: usize = 32;

/// Computes the normals of the slots of the selected fans. `softness` tells for each edge how smooth it is, from 1 to 0
/// at a crease.
pub(super) fn compute_normals(
    parallel: &impl Parallel,
    selection: &Selection,
    fans: &Fans,
    faces: &[Face],
    softness: &[f32],
    normals: &mut Vec<Vec3A>,
) {
    normals.resize(fans.slots().len(), Vec3A::ZERO);
    let parts = selection.parts_of(normals, |fan| fans.fan(fan as usize).0);
    parallel.run_tasks(parts, selection.share(), |mut normals| {
        for &fan in normals.items {
            let (slots, closed) = fans.fan(fan as usize);
            write_normals(&fans.slots()[slots.clone()], closed, faces, softness, normals.range(slots));
        }
    });
}

/// Writes the normals of a fan's corners. Faces across a crease do not count.
#[inline]
fn write_normals(slots: &[Slot], closed: bool, faces: &[Face], softness: &[f32], normals: &mut [Vec3A]) {
    let weighted = |slot: &Slot| {
        let face = &faces[slot.triangle as usize];
        face.normal() * face.weight(slot.corner as usize)
    };
    let (mut sum, mut least) = (Vec3A::ZERO, 1.0_f32);
    for slot in slots {
        sum += weighted(slot);
        if slot.next_edge != NONE {
            least = least.min(softness[slot.next_edge as usize]);
        }
    }
    if least >= 1.0 {
        normals.fill(sum.normalize_or_zero());
        return;
    }
    let count = slots.len();
    // From a face of the fan to the next one.
    let soft = |place: usize| softness[slots[place].next_edge as usize];
    for own in 0..count {
        let mut sum = weighted(&slots[own]);
        // By how much each face counts: as much as the smoothest way there is smooth.
        let (mut forward, mut backward) = (1.0_f32, 1.0_f32);
        let mut shares = [0.0_f32; MOST_FACES];
        // Steps backward are counted from the end of the shares.
        let end = count.min(MOST_FACES);
        let reach = if count > MOST_FACES { MOST_FACES / 2 } else { count };
        for step in 1..reach {
            let last = own + step - 1;
            forward *= if closed || last + 1 < count { soft(last % count) } else { 0.0 };
            let share = &mut shares[step];
            *share = share.max(forward);
            let next = (own + count - step) % count;
            backward *= if closed || step <= own { soft(next) } else { 0.0 };
            let share = &mut shares[end - step];
            *share = share.max(backward);
            if forward == 0.0 && backward == 0.0 {
                break;
            }
        }
        for (place, share) in shares.iter().enumerate().take(end).skip(1) {
            if *share > 0.0 {
                let step = if place < reach { place } else { count - end + place };
                sum += weighted(&slots[(own + step) % count]) * *share;
            }
        }
        normals[own] = sum.normalize_or_zero();
    }
}
