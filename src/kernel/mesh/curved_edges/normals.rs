//! The normals at the corners of triangles, which end at creases.

use glam::Vec3A;

use super::faces::Face;
use crate::kernel::{
    mesh::fans::{Fans, NONE, Slot},
    simd::parallel::{LEAST_SHARE, PART, Parallel},
};

/// Around a vertex with a crease and more faces than this, only those less than half as many steps away count.
const MOST_FACES: usize = 32;

/// Computes the normals of all slots. `softness` tells for each edge how smooth it is, from 1 to 0 at a crease.
pub(super) fn compute_normals(
    parallel: &impl Parallel,
    fans: &Fans,
    faces: &[Face],
    softness: &[f32],
    normals: &mut Vec<Vec3A>,
) {
    normals.resize(fans.slots().len(), Vec3A::ZERO);
    parallel.run_tasks(parts_of_fans(fans, normals), fans.len() / LEAST_SHARE, |(part, normals)| {
        let first = fans.fan(part.start).0.start;
        for fan in part {
            let (slots, closed) = fans.fan(fan);
            let own = slots.start - first..slots.end - first;
            write_normals(&fans.slots()[slots], closed, faces, softness, &mut normals[own]);
        }
    });
}

/// Consecutive parts of the fans, each with the normals of its slots.
fn parts_of_fans<'a>(
    fans: &'a Fans,
    normals: &'a mut [Vec3A],
) -> impl Iterator<Item = (std::ops::Range<usize>, &'a mut [Vec3A])> + Send {
    let mut rest = normals;
    (0..fans.len()).step_by(PART).map(move |first| {
        let part = first..(first + PART).min(fans.len());
        let count = fans.fan(part.end - 1).0.end - fans.fan(part.start).0.start;
        let (own, later) = std::mem::take(&mut rest).split_at_mut(count);
        rest = later;
        (part, own)
    })
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
