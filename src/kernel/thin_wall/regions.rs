//! The hierarchy of plates and ribs, and the account of all area.

use std::collections::BTreeMap;

use super::{
    body::{Body, NO_TRIANGLE},
    pairing::Pairing,
    segments::{NO_SEGMENT, Segments},
    sheet::Sheet,
    walls::{NO_WALL, Role, Walls},
};

/// A wall stands on another one as a rib if this share of their common edges is concave: it rises from the middle of the
/// other. Where they meet in an L, half of it is.
const RIB_SHARE: f64 = 0.7;

/// What a region is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RegionKind {
    /// A wall that stands on no other, or continues one around an edge.
    Plate,
    /// A wall that stands on a larger one.
    Rib,
}

/// A wall that has become a part of the sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct ThinRegion {
    /// What it is.
    pub kind: RegionKind,
    /// The area of the original surface that it replaces: both sides and rims.
    pub area: f64,
    /// The least thickness at a vertex of its sheet.
    pub thickness_min: f64,
    /// The largest thickness at a vertex of its sheet.
    pub thickness_max: f64,
    /// The larger region that it is attached to, as an index.
    pub parent: Option<usize>,
}

/// Why a part of the original stays as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LeftOutReason {
    /// No face lies opposite within reach, at an angle of no more than
    /// [`opposed_angle`](super::settings::ThinWallSettings::opposed_angle).
    NoOpposite,
    /// It is not [`least_extent`](super::settings::ThinWallSettings::least_extent) times as wide as thick.
    NotThin,
    /// It is thin, but what is opposite it is no part of the same wall.
    OppositeLeft,
    /// It is thin, but its two sides are one smooth face that folds back.
    Folded,
    /// It is thin, but its sheet would be farther than a quarter of its thickness from it.
    Inaccurate,
}

impl LeftOutReason {
    /// Whether the part is thin nevertheless.
    #[must_use]
    pub fn is_thin(self) -> bool {
        matches!(self, Self::OppositeLeft | Self::Folded | Self::Inaccurate)
    }
}

impl std::fmt::Display for LeftOutReason {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            Self::NoOpposite => "not thin: no opposite face",
            Self::NotThin => "not thin: too thick for its width",
            Self::OppositeLeft => "thin, but the opposite face belongs to no wall",
            Self::Folded => "thin, but both sides are one smooth face",
            Self::Inaccurate => "thin, but no sheet is within a quarter of its thickness",
        })
    }
}

/// A part of the original that stays as it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Why.
    pub reason: LeftOutReason,
    /// Its area.
    pub area: f64,
}

/// What has become of each triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    Replaced { wall: u32 },
    Left(LeftOutReason),
}

impl Fate {
    pub(super) fn is_replaced(self) -> bool {
        matches!(self, Self::Replaced { .. })
    }
}

/// The fate of each triangle. `covered` are the walls of rims.
pub(super) fn fates(
    body: &Body,
    pairing: &Pairing,
    segments: &Segments,
    walls: &Walls,
    is_thin: &[bool],
    is_inaccurate: &[bool],
    covered: &[u32],
) -> Vec<Fate> {
    let mut fates: Vec<Fate> = (0..body.triangle_count())
        .map(|triangle| {
            let segment = segments.of[triangle];
            if walls.roles[triangle] != Role::Rest {
                return Fate::Replaced { wall: walls.of_segment[segment as usize] };
            }
            if covered[triangle] != NO_WALL {
                return Fate::Replaced { wall: covered[triangle] };
            }
            Fate::Left(if is_thin[triangle] && is_inaccurate[triangle] {
                LeftOutReason::Inaccurate
            } else if is_thin[triangle] {
                let folds = pairing
                    .of(triangle)
                    .iter()
                    .filter_map(|sample| sample.opposite)
                    .any(|opposite| segment != NO_SEGMENT && segments.of[opposite.triangle as usize] == segment);
                if folds { LeftOutReason::Folded } else { LeftOutReason::OppositeLeft }
            } else if pairing.is_paired[triangle] {
                LeftOutReason::NotThin
            } else {
                LeftOutReason::NoOpposite
            })
        })
        .collect();
    for triangle in 0..fates.len() {
        if body.duplicate_of[triangle] != NO_TRIANGLE {
            fates[triangle] = fates[body.duplicate_of[triangle] as usize];
        }
    }
    fates
}

/// Lengths of the edges between two walls: concave, and all.
type Contacts = BTreeMap<(u32, u32), [f64; 2]>;

fn contacts(body: &Body, segments: &Segments, walls: &Walls) -> Contacts {
    let mut contacts = Contacts::new();
    let wall = |triangle: usize| match walls.roles[triangle] {
        Role::Rest => NO_WALL,
        _ => walls.of_segment[segments.of[triangle] as usize],
    };
    for triangle in (0..body.triangle_count()).filter(|&triangle| wall(triangle) != NO_WALL) {
        let corners = &body.facets.corners[triangle];
        for edge in 0..3 {
            let Some(other) = body.neighbor(triangle, edge) else { continue };
            if wall(other) != NO_WALL && wall(other) != wall(triangle) {
                let length = corners[edge].distance(corners[(edge + 1) % 3]);
                let lengths = contacts.entry((wall(triangle), wall(other))).or_default();
                lengths[0] += if body.is_convex(triangle, other) { 0.0 } else { length };
                lengths[1] += length;
            }
        }
    }
    contacts
}

/// The regions, largest first, and the region of each wall, or [`NO_WALL`] if it has no sheet.
pub(super) fn regions(
    body: &Body,
    segments: &Segments,
    walls: &Walls,
    sheet: &Sheet,
    fates: &[Fate],
) -> (Vec<ThinRegion>, Vec<u32>) {
    let mut areas = vec![0.0; walls.count];
    for (triangle, fate) in fates.iter().enumerate() {
        if let Fate::Replaced { wall } = fate {
            areas[*wall as usize] += body.areas[triangle];
        }
    }
    let mut thickness = vec![[f64::INFINITY, 0.0]; walls.count];
    for (corners, &wall) in sheet.triangles.iter().zip(&sheet.walls) {
        let [least, most] = &mut thickness[wall as usize];
        for &vertex in corners {
            *least = least.min(2.0 * sheet.halves[vertex as usize]);
            *most = most.max(2.0 * sheet.halves[vertex as usize]);
        }
    }
    let mut order: Vec<usize> = (0..walls.count).filter(|&wall| areas[wall] > 0.0).collect();
    order.sort_by(|&a, &b| areas[b].total_cmp(&areas[a]).then(a.cmp(&b)));
    let mut region_of = vec![NO_WALL; walls.count];
    for (region, &wall) in order.iter().enumerate() {
        region_of[wall] = region as u32;
    }
    let mut regions: Vec<ThinRegion> = order
        .iter()
        .map(|&wall| {
            let [least, most] = thickness[wall];
            let (thickness_min, thickness_max) = (least.min(most), most);
            ThinRegion { kind: RegionKind::Plate, area: areas[wall], thickness_min, thickness_max, parent: None }
        })
        .collect();
    let mut longest = vec![0.0; regions.len()];
    for (&(wall, other), &[concave, all]) in &contacts(body, segments, walls) {
        let (region, other) = (region_of[wall as usize] as usize, region_of[other as usize] as usize);
        // Larger regions come first.
        if other < region && all > longest[region] {
            longest[region] = all;
            regions[region].parent = Some(other);
            regions[region].kind = if concave >= RIB_SHARE * all { RegionKind::Rib } else { RegionKind::Plate };
        }
    }
    (regions, region_of)
}

/// The areas that are left, by reason.
pub(super) fn left_out(body: &Body, fates: &[Fate]) -> Vec<LeftOut> {
    let mut areas: BTreeMap<LeftOutReason, f64> = BTreeMap::new();
    for (triangle, fate) in fates.iter().enumerate() {
        if let Fate::Left(reason) = fate {
            *areas.entry(*reason).or_default() += body.areas[triangle];
        }
    }
    areas.into_iter().map(|(reason, area)| LeftOut { reason, area }).collect()
}
