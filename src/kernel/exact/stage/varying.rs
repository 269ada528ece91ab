//! The exact stage where the thickness of a side differs from vertex to vertex: the same screen with the largest
//! thickness, then each pair that it leaves by itself.

use super::{
    CornerRow, PairScreen, ScreenLimits,
    contacts::{contact, numbers},
    reports::reports,
    rows_of,
};
use crate::kernel::{
    contact::TouchingPair,
    exact::{thick_pair::ThickProximity, tolerances::TIE},
    mesh::feature::FeatureKind,
    pair::{FoundPairs, PairSettings, SurfaceSide},
    simd::lanes::{SetLanes, first_lanes},
};

/// Tests pairs exactly. With `only_closest`, a pair that does not cross makes a contact of its closest features only.
pub(super) fn examine_pairs(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
    only_closest: bool,
) {
    found.examined += candidates.len();
    let mut limits = ScreenLimits {
        scale: settings.scale,
        ranges: [settings.range; PairScreen::WIDTH],
        contact_distance: settings.contact_distance,
    };
    let poses = [a, b].map(|side| side.moved.map(|moved| moved.pose));
    let mut screen = PairScreen::new();
    let mut made = [[CornerRow::EMPTY; PairScreen::WIDTH]; 2];
    let [made_a, made_b] = &mut made;
    let mut proximity = ThickProximity::default();
    let first_contact = found.contacts.len();
    for pairs in candidates.chunks(PairScreen::WIDTH) {
        let mut possible = first_lanes(pairs.len()) as u32;
        if settings.cull || found.wants_lower_bounds {
            // What lacks everywhere on both triangles is no part of their distance.
            for (range, &[triangle_a, triangle_b]) in limits.ranges.iter_mut().zip(pairs) {
                *range = settings.range - a.least_lack(triangle_a) - b.least_lack(triangle_b);
            }
            let rows = [rows_of::<0>(a, pairs, made_a), rows_of::<1>(b, pairs, made_b)];
            let screened = screen.screen([&rows[0], &rows[1]], poses, pairs.len(), &limits);
            if settings.cull {
                possible = screened.possible;
            }
            if found.wants_lower_bounds {
                found.lower_bounds.extend_from_slice(&screen.lower_bounds()[..pairs.len()]);
            }
        }
        for place in SetLanes(possible) {
            examine(a, b, pairs[place], settings, found, &mut proximity, only_closest);
        }
    }
    found.finish_contacts(first_contact);
}

fn examine(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    triangles: [u32; 2],
    settings: &PairSettings,
    found: &mut FoundPairs,
    proximity: &mut ThickProximity,
    only_closest: bool,
) {
    let corners = [a.corners(triangles[0]), b.corners(triangles[1])];
    let lacks = [a.lacks(triangles[0]), b.lacks(triangles[1])].map(|lacks| lacks.map(|lack| lack / settings.scale));
    proximity.examine(&corners, lacks, settings.range / settings.scale);
    let ThickProximity { pair, reaches, least } = proximity;
    let reach = *least * settings.scale;
    if reach > settings.range {
        return;
    }
    found.nearest = found.nearest.min(reach);
    if reach <= settings.contact_distance {
        let [triangle_a, triangle_b] = triangles;
        found.touching.push(TouchingPair { triangle_a, triangle_b, distance: pair.distance * settings.scale });
    }
    for (features, own_reach) in pair.proximities.iter().zip(&*reaches) {
        let crosses = features.features.kind() == FeatureKind::EdgeFace;
        if *own_reach * settings.scale > settings.reported_distance
            || only_closest && !crosses && *own_reach > *least * (1.0 + TIE) && pair.distance > 0.0
        {
            continue;
        }
        let is_shared = if only_closest { Some(true) } else { reports(a, b, settings, triangles, features.features) };
        if let Some(is_shared) = is_shared {
            let numbers = numbers(a, b, triangles, features.features);
            found.contacts.push(contact(a, b, settings, triangles, numbers, is_shared, &corners, features));
        }
    }
}
