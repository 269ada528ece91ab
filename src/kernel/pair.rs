//! What every stage over triangle pairs shares: the two sides in one frame, the distances that matter, what was found.

use std::borrow::Cow;

use glam::{DVec3, Vec3};

use super::{
    capacity,
    contact::{CompactContact, SharedContact, TouchingPair, feature_number},
    mesh::{
        corner_rows::{CornerRow, CornerRows},
        feature::{Feature, FeaturePair},
        ids::TriangleId,
        side::{outward_direction, rise},
        topology::SurfaceTopology,
    },
    pose::Pose,
};

/// One side of a pair, in the frame of the pair.
#[derive(Clone, Copy)]
pub struct SurfaceSide<'a> {
    /// Its triangles.
    pub topology: &'a SurfaceTopology,
    /// Its vertices in the frame of the pair, rounded to f32 there.
    pub positions: &'a [Vec3],
    /// How they came there; `None` where they are in their own frame.
    pub moved: Option<MovedSide<'a>>,
    /// Whether it has an inside, so that the sign of its distance is known.
    pub one_sided: bool,
    /// Whether the way to the frame of the pair turned its outward normals inward.
    pub mirrored: bool,
    /// The rows of its triangles, where somebody has made them: worth it where most triangles are in several pairs.
    pub rows: Option<&'a CornerRows>,
}

/// The way of a side to the frame of the pair. Far from that frame's origin f32 is coarse: exact tests move the
/// vertices again, and do not round them.
#[derive(Clone, Copy)]
pub struct MovedSide<'a> {
    /// The vertices in the side's own frame.
    pub own_positions: &'a [Vec3],
    /// From there to the frame of the pair.
    pub pose: &'a Pose,
    /// How far rounding may have put a vertex from where it is, in the unit of the frame of the pair.
    pub rounding: f32,
}

impl<'a> MovedSide<'a> {
    /// `moved_positions` are those that the pose makes of `own_positions`.
    #[must_use]
    pub fn new(own_positions: &'a [Vec3], pose: &'a Pose, moved_positions: &[Vec3]) -> Self {
        let largest = moved_positions.iter().fold(Vec3::ZERO, |largest, position| largest.max(position.abs()));
        // Half a unit in the last place along each of three axes.
        Self { own_positions, pose, rounding: f32::EPSILON * largest.max_element() }
    }
}

impl SurfaceSide<'_> {
    /// The corners of a triangle in the frame of the pair, not rounded.
    #[inline]
    pub(in crate::kernel) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let [first, second, third] = self.topology.triangles()[triangle as usize];
        let corner = |vertex: u32| self.moved_point(self.own_positions()[vertex as usize].as_dvec3());
        [corner(first), corner(second), corner(third)]
    }

    /// The vertices in the side's own frame.
    #[inline]
    pub(in crate::kernel) fn own_positions(&self) -> &[Vec3] {
        self.moved.as_ref().map_or(self.positions, |moved| moved.own_positions)
    }

    /// A point of the side's own frame in the frame of the pair.
    #[inline]
    pub(in crate::kernel) fn moved_point(&self, point: DVec3) -> DVec3 {
        self.moved.as_ref().map_or(point, |moved| moved.pose.transform_point(point))
    }

    /// Whether a pose is the way to the frame of the pair; `None` where the side's own frame is that.
    #[inline]
    pub(in crate::kernel) fn is_moved_by(&self, pose: Option<&Pose>) -> bool {
        self.moved.map(|moved| moved.pose) == pose
    }

    /// Makes a row for one triangle.
    #[inline]
    pub(in crate::kernel) fn row(&self, triangle: u32) -> CornerRow {
        CornerRow::new(self.topology, self.own_positions(), triangle)
    }

    pub(in crate::kernel) fn outward(&self, triangle: u32, feature: Feature) -> DVec3 {
        if let Some(moved) = &self.moved {
            // Turned as a direction, which a mirrored pose leaves outward.
            let outward = outward_direction(self.topology, moved.own_positions, triangle as usize, feature);
            return moved.pose.transform_direction(outward);
        }
        let outward = outward_direction(self.topology, self.positions, triangle as usize, feature);
        if self.mirrored { -outward } else { outward }
    }

    /// How a direction goes along the [outward](Self::outward) one: more than 0 where it leads out, less than 0 where it leads
    /// in.
    pub(in crate::kernel) fn rise(&self, triangle: u32, feature: Feature, direction: DVec3) -> f64 {
        if let Some(moved) = &self.moved {
            let direction = moved.pose.inverse_transform_direction(direction);
            return rise(self.topology, moved.own_positions, triangle as usize, feature, direction);
        }
        let direction = if self.mirrored { -direction } else { direction };
        rise(self.topology, self.positions, triangle as usize, feature, direction)
    }

    /// How far rounding may have put a position from where it is.
    pub(crate) fn rounding(&self) -> f32 {
        self.moved.map_or(0.0, |moved| moved.rounding)
    }
}

/// A pair of triangles by their rows.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct RowPair<'a> {
    /// Both sides in the frame of the pair.
    pub(in crate::kernel) sides: [&'a SurfaceSide<'a>; 2],
    /// One triangle of each.
    pub(in crate::kernel) triangles: [u32; 2],
    /// The rows of those.
    pub(in crate::kernel) rows: [&'a CornerRow; 2],
}

impl RowPair<'_> {
    /// A corner of either triangle in the frame of the pair, not rounded.
    #[inline]
    pub(in crate::kernel) fn corner(&self, side: usize, corner: usize) -> DVec3 {
        self.sides[side].moved_point(self.rows[side].corner(corner))
    }

    /// The three corners of either triangle.
    #[inline]
    pub(in crate::kernel) fn corners(&self, side: usize) -> [DVec3; 3] {
        [self.corner(side, 0), self.corner(side, 1), self.corner(side, 2)]
    }

    /// Whether the two share a vertex, given that the sides are the same surface.
    #[inline]
    pub(in crate::kernel) fn are_neighbors(&self) -> bool {
        let [a, b] = self.triangles.map(TriangleId);
        self.sides[0].topology.share_vertex(a, b)
    }

    /// The [number](feature_number) of a part of either triangle, see [`Feature::of_part`].
    #[inline]
    pub(in crate::kernel) fn number(&self, side: usize, part: usize) -> u32 {
        let (SurfaceSide { topology, positions, .. }, triangle) = (self.sides[side], self.triangles[side]);
        if topology.is_welded() {
            return feature_number(topology, positions, triangle, Feature::of_part(part));
        }
        self.rows[side].number(triangle, part)
    }

    /// The numbers of two features.
    #[inline]
    pub(in crate::kernel) fn numbers(&self, FeaturePair { a, b }: FeaturePair) -> [u32; 2] {
        [self.number(0, a.part()), self.number(1, b.part())]
    }
}

/// Whether the sides can be inside each other: then penetrations are settled, and about features that are inside each pair
/// of triangles has a say of its own.
#[must_use]
pub fn can_penetrate(sides: [&SurfaceSide<'_>; 2], settings: &PairSettings) -> bool {
    !settings.same_surface && sides.iter().any(|side| side.one_sided)
}

/// Whether the sides have passed each other, as far as a one-sided surface tells, given the way from the second to the first.
/// A face tells best, of two edges the second side's. A vertex or an edge that is close to another triangle's boundary may be
/// closer still to a neighbor of it, and then its direction misleads: where both sides have an inside, both have to agree.
pub(in crate::kernel) fn is_inside(
    [a, b]: [&SurfaceSide<'_>; 2],
    [triangle_a, triangle_b]: [u32; 2],
    features: FeaturePair,
    separation: DVec3,
) -> bool {
    let behind_b = || b.rise(triangle_b, features.b, separation) < 0.0;
    let behind_a = || a.rise(triangle_a, features.a, separation) > 0.0;
    match (a.one_sided, b.one_sided) {
        (true, true) => match (features.a, features.b) {
            (Feature::Face, _) => behind_a(),
            (_, Feature::Face) | (Feature::Edge(_), Feature::Edge(_)) => behind_b(),
            _ => behind_a() && behind_b(),
        },
        (false, true) => behind_b(),
        (true, false) => behind_a(),
        (false, false) => false,
    }
}

/// How a list of pairs is tested. Lengths are in world units.
#[derive(Clone, Copy, Debug)]
pub struct PairSettings {
    /// Triangles touch within this distance.
    pub contact_distance: f64,
    /// Contacts are written up to this distance, at least `contact_distance`.
    pub reported_distance: f64,
    /// The nearest pair is looked for up to this distance, at least `reported_distance`.
    pub range: f64,
    /// World length of a unit of the frame of the pair.
    pub scale: f64,
    /// Whether a quicker test of eight pairs side by side comes first: a screen of features before exact ones, slabs before
    /// caps. The screen changes the time and how often the same contact is reported, never the result without
    /// [repeats](super::exact::unique::UniqueFeatures); slabs drop pairs that caps alone would let touch.
    pub cull: bool,
    /// Whether both sides are the same surface.
    pub same_surface: bool,
}

/// What a list of pairs amounts to.
#[derive(Clone, Debug)]
pub struct FoundPairs {
    /// Pairs of triangles that touch, in the order of the candidates.
    pub touching: Vec<TouchingPair>,
    /// Contacts, in the order of the candidates, those of one pair by key. Those that are
    /// [shared](CompactContact::is_shared) may occur several times, under the same key, until
    /// [`UniqueFeatures`](super::exact::unique::UniqueFeatures) has dropped the repeats.
    pub contacts: Vec<CompactContact>,
    /// Which contacts of the exact test are shared; once repeats have been dropped, only those that have sides.
    pub shared: Vec<SharedContact>,
    /// Distance of the nearest pair in world units, at least 0; infinite where none is within range.
    pub nearest: f64,
    /// How many pairs reached the exact test.
    pub examined: usize,
    /// Of each candidate of the exact test, in their order, a lower bound of its distance in the unit of the frame of the
    /// pair, rounded down: its distance, but for rounding, where it is apart, even beyond the range. Only where wanted.
    pub lower_bounds: Vec<f32>,
    /// Whether those are wanted: not unless somebody says so.
    pub wants_lower_bounds: bool,
}

impl Default for FoundPairs {
    fn default() -> Self {
        Self {
            touching: Vec::new(),
            contacts: Vec::new(),
            shared: Vec::new(),
            nearest: f64::INFINITY,
            examined: 0,
            lower_bounds: Vec::new(),
            wants_lower_bounds: false,
        }
    }
}

impl FoundPairs {
    /// Empties the lists and keeps their memory.
    pub fn clear(&mut self) {
        self.touching.clear();
        self.contacts.clear();
        self.shared.clear();
        self.nearest = f64::INFINITY;
        self.examined = 0;
        self.lower_bounds.clear();
    }

    /// Empties the lists and keeps room for about as much as they held.
    pub(crate) fn clear_room(&mut self) {
        capacity::clear(&mut self.touching);
        capacity::clear(&mut self.contacts);
        capacity::clear(&mut self.shared);
        capacity::clear(&mut self.lower_bounds);
        self.clear();
    }

    /// Appends what was found in a later part of the pairs by faces, which are sorted: a pair that stands on both sides of
    /// the cut has one contact.
    pub fn append_sorted(&mut self, later: &mut Self) {
        if let (Some(last), Some(first)) = (self.contacts.last(), later.contacts.first())
            && last.key == first.key
        {
            later.contacts.remove(0);
        }
        self.append(later);
    }

    /// Brings the contacts from the place `first` on into their order, given that those of different pairs are, and lists
    /// which of them are shared, given that those before are listed.
    pub(crate) fn finish_contacts(&mut self, first: usize) {
        const STEP: usize = 64;
        let contacts = &mut self.contacts[first..];
        for place in 1..contacts.len() {
            let mut place = place;
            while place > 0 && is_later_of_pair(&contacts[place - 1], &contacts[place]) {
                contacts.swap(place - 1, place);
                place -= 1;
            }
        }
        let mut place = first as u32;
        for contacts in contacts.chunks(STEP) {
            // Those that are not shared are written over: which ones those are nobody can foresee.
            let mut count = self.shared.len();
            self.shared.resize(count + contacts.len(), SharedContact { key: CompactContact::NONE.key, place: 0 });
            for contact in contacts {
                self.shared[count] = SharedContact { key: contact.key, place };
                count += usize::from(contact.is_shared);
                place += 1;
            }
            self.shared.truncate(count);
        }
    }

    /// Brings touching pairs into their order, where they are in that of the contacts: where a surface meets itself, those of
    /// spheres are sorted by the lower triangle, whichever stands first.
    pub(crate) fn sort_touching(&mut self) {
        let place = |pair: &TouchingPair| (pair.triangle_a, pair.triangle_b);
        if !self.touching.is_sorted_by_key(place) {
            self.touching.sort_unstable_by_key(place);
        }
    }

    /// Appends what was found in a later part of the candidates.
    pub fn append(&mut self, later: &mut Self) {
        self.touching.append(&mut later.touching);
        let before = self.contacts.len() as u32;
        self.shared.extend(later.shared.drain(..).map(|shared| shared.later(before)));
        self.contacts.append(&mut later.contacts);
        self.nearest = self.nearest.min(later.nearest);
        self.examined += later.examined;
        self.lower_bounds.append(&mut later.lower_bounds);
    }
}

/// Whether a contact stands after another one of the same triangles.
#[inline]
fn is_later_of_pair(one: &CompactContact, other: &CompactContact) -> bool {
    (one.key > other.key) & (one.triangles() == other.triangles())
}

/// The candidates without those that share a vertex, which in a self-collision are neighbors. The list itself where
/// there are none, as a broad phase has left them out already.
pub(in crate::kernel) fn without_neighbors<'a>(
    surface: &SurfaceSide<'_>,
    candidates: &'a [[u32; 2]],
    settings: &PairSettings,
) -> Cow<'a, [[u32; 2]]> {
    let neighbors = |pair: &[u32; 2]| surface.topology.share_vertex(TriangleId(pair[0]), TriangleId(pair[1]));
    if settings.same_surface && candidates.iter().any(neighbors) {
        Cow::Owned(candidates.iter().copied().filter(|pair| !neighbors(pair)).collect())
    } else {
        Cow::Borrowed(candidates)
    }
}
