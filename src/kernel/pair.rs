//! What all stages over triangle pairs share: the two sides in one frame, the distances that matter, and the results.

use glam::{DVec3, Vec3};

use super::{
    contact::{CompactContact, SharedContact, TouchingPair, feature_number},
    mesh::{
        corner_rows::{CornerRow, CornerRows},
        curved_edges::CurvedEdges,
        feature::{Feature, FeaturePair},
        side::{outward_direction, rise},
        thickness::VaryingThickness,
        topology::SurfaceTopology,
    },
    pose::Pose,
    simd::prefetch::Prefetch,
};

/// One side of a pair, in the pair's frame.
#[derive(Clone, Copy)]
pub struct SurfaceSide<'a> {
    /// Its triangles.
    pub topology: &'a SurfaceTopology,
    /// Its vertices in the pair's frame, rounded to f32.
    pub positions: &'a [Vec3],
    /// How they were transformed. `None` if the side's own frame is the pair's frame.
    pub moved: Option<MovedSide<'a>>,
    /// Whether it has an inside, so that the sign of its distance is known.
    pub one_sided: bool,
    /// Whether the transform to the pair's frame flips its outward normals inward.
    pub mirrored: bool,
    /// The rows of its triangles, if they have been made. Worthwhile if most triangles are in several pairs.
    pub rows: Option<&'a CornerRows>,
    /// The curved edges of a smooth surface, in its own frame. `None` if it is flat.
    pub curved: Option<&'a CurvedEdges>,
    /// The thickness at each vertex. `None` if it is the same everywhere.
    pub thickness: Option<VaryingThickness<'a>>,
}

/// The transform of a side to the pair's frame. Far from that frame's origin f32 is coarse, so exact tests transform
/// the vertices again without rounding them.
#[derive(Clone, Copy)]
pub struct MovedSide<'a> {
    /// The vertices in the side's own frame.
    pub own_positions: &'a [Vec3],
    /// From the side's own frame to the pair's frame.
    pub pose: &'a Pose,
    /// How far rounding may have displaced a vertex, in the unit of the pair's frame.
    pub rounding: f32,
}

impl<'a> MovedSide<'a> {
    /// `moved_positions` are the `own_positions` that `pose` has transformed.
    #[must_use]
    pub fn new(own_positions: &'a [Vec3], pose: &'a Pose, moved_positions: &[Vec3]) -> Self {
        let largest = moved_positions.iter().fold(Vec3::ZERO, |largest, position| largest.max(position.abs()));
        // Half a unit in the last place along each of three axes.
        Self { own_positions, pose, rounding: f32::EPSILON * largest.max_element() }
    }
}

impl<'a> SurfaceSide<'a> {
    /// A flat side in its own frame, without an inside.
    #[must_use]
    pub const fn flat(topology: &'a SurfaceTopology, positions: &'a [Vec3]) -> Self {
        Self {
            topology,
            positions,
            moved: None,
            one_sided: false,
            mirrored: false,
            rows: None,
            curved: None,
            thickness: None,
        }
    }

    /// Whether the thickness is the same everywhere.
    #[inline]
    pub(crate) const fn is_evenly_thick(&self) -> bool {
        self.thickness.is_none()
    }

    /// The side with the largest thickness everywhere.
    #[must_use]
    pub const fn evenly_thick(self) -> Self {
        Self { thickness: None, ..self }
    }
}

impl SurfaceSide<'_> {
    /// The corners of a triangle in the pair's frame, not rounded.
    #[inline]
    pub(crate) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let [first, second, third] = self.topology.triangles()[triangle as usize];
        let corner = |vertex: u32| self.moved_point(self.own_positions()[vertex as usize].as_dvec3());
        [corner(first), corner(second), corner(third)]
    }

    /// The corners of a triangle in the side's own frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn own_corners(&self, triangle: u32) -> [Vec3; 3] {
        if let Some(rows) = self.rows {
            return rows.of(triangle).corners.map(Vec3::from_array);
        }
        self.topology.triangles()[triangle as usize].map(|vertex| self.own_positions()[vertex as usize])
    }

    /// The vertices in the side's own frame.
    #[inline]
    pub(in crate::kernel) fn own_positions(&self) -> &[Vec3] {
        self.moved.as_ref().map_or(self.positions, |moved| moved.own_positions)
    }

    /// Transforms a point from the side's own frame to the pair's frame.
    #[inline]
    pub(in crate::kernel) fn moved_point(&self, point: DVec3) -> DVec3 {
        self.moved.as_ref().map_or(point, |moved| moved.pose.transform_point(point))
    }

    /// Whether `pose` is the transform to the pair's frame. `None` means that the side's own frame is the pair's frame.
    #[inline]
    pub(in crate::kernel) fn is_moved_by(&self, pose: Option<&Pose>) -> bool {
        self.moved.map(|moved| moved.pose) == pose
    }

    /// Builds the row of one triangle.
    #[inline]
    pub(in crate::kernel) fn row(&self, triangle: u32) -> CornerRow {
        CornerRow::new(self.topology, self.own_positions(), triangle)
    }

    pub(in crate::kernel) fn outward(&self, triangle: u32, feature: Feature) -> DVec3 {
        if let Some(moved) = &self.moved {
            // Transformed as a direction, which stays outward even if the pose is mirrored.
            let outward = outward_direction(self.topology, moved.own_positions, triangle as usize, feature);
            return moved.pose.transform_direction(outward);
        }
        let outward = outward_direction(self.topology, self.positions, triangle as usize, feature);
        if self.mirrored { -outward } else { outward }
    }

    /// Whether a direction leads out, judged by the [outward](Self::outward) direction: greater than 0 if it leads out,
    /// less than 0 if it leads in. Only the sign is meaningful.
    pub(in crate::kernel) fn rise(&self, triangle: u32, feature: Feature, direction: DVec3) -> f64 {
        if let Some(moved) = &self.moved {
            let direction = moved.pose.inverse_transform_direction(direction);
            return rise(self.topology, moved.own_positions, triangle as usize, feature, direction);
        }
        let direction = if self.mirrored { -direction } else { direction };
        rise(self.topology, self.positions, triangle as usize, feature, direction)
    }

    /// How far the patch of a triangle may be from it, in the unit of the pair's frame. 0 if the surface is flat.
    #[inline]
    pub(crate) fn patch_height(&self, triangle: u32) -> f64 {
        self.curved.map_or(0.0, |curved| f64::from(curved.heights()[triangle as usize]) * self.scale())
    }

    /// By how much the thickness at each corner of a triangle is less than the surface's largest, in world units.
    #[inline]
    pub(in crate::kernel) fn lacks(&self, triangle: u32) -> [f64; 3] {
        self.thickness.map_or([0.0; 3], |thickness| thickness.lacks(self.topology.triangles()[triangle as usize]))
    }

    /// What lacks at a point of a triangle, given the weights of its first two corners.
    #[inline]
    pub(crate) fn lack_at(&self, triangle: u32, [first, second]: [f32; 2]) -> f64 {
        let Some(thickness) = self.thickness else { return 0.0 };
        thickness.lack_at(self.topology.triangles()[triangle as usize], [first, second])
    }

    /// The least of the [lacks](Self::lacks) of a triangle.
    #[inline]
    pub(crate) fn least_lack(&self, triangle: u32) -> f64 {
        self.lacks(triangle).into_iter().fold(f64::INFINITY, f64::min)
    }

    /// The length of a unit of the side's own frame in that of the pair, rounded up.
    #[inline]
    fn scale(&self) -> f64 {
        self.moved.map_or(1.0, |moved| moved.pose.largest_scale())
    }

    /// How far rounding may have displaced a position, in the unit of the pair's frame.
    pub(crate) fn rounding(&self) -> f32 {
        self.moved.map_or(0.0, |moved| moved.rounding)
    }
}

impl Prefetch for SurfaceSide<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn prefetch(&self, triangle: u32) {
        if let Some(rows) = self.rows {
            rows.prefetch(triangle);
        }
        if let Some(curved) = self.curved {
            curved.prefetch(triangle);
        }
    }
}

/// A pair of triangles with their rows.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct RowPair<'a> {
    /// Both sides, in the pair's frame.
    pub(in crate::kernel) sides: [&'a SurfaceSide<'a>; 2],
    /// One triangle of each side.
    pub(in crate::kernel) triangles: [u32; 2],
    /// The rows of the triangles.
    pub(in crate::kernel) rows: [&'a CornerRow; 2],
}

impl RowPair<'_> {
    /// A corner of one of the triangles in the pair's frame, not rounded.
    #[inline]
    pub(in crate::kernel) fn corner(&self, side: usize, corner: usize) -> DVec3 {
        self.sides[side].moved_point(self.rows[side].corner(corner))
    }

    /// The three corners of one of the triangles.
    #[inline]
    pub(in crate::kernel) fn corners(&self, side: usize) -> [DVec3; 3] {
        [self.corner(side, 0), self.corner(side, 1), self.corner(side, 2)]
    }

    /// The [number](feature_number) of a feature. The feature is given by its local index, see [`Feature::of_part`].
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

/// Whether the sides can be inside each other. If so, penetrations are resolved, and each pair of triangles reports
/// features that are inside on its own.
#[must_use]
pub fn can_penetrate(sides: [&SurfaceSide<'_>; 2], settings: &PairSettings) -> bool {
    !settings.same_surface && sides.iter().any(|side| side.one_sided)
}

/// Whether the sides have passed each other, judged by the sides that have an inside, given the vector from the second
/// side to the first. A face is the best judge; of two edges, the second side's. A vertex or an edge near the boundary
/// of another triangle may be closer still to one of that triangle's neighbors, and then its direction is misleading:
/// if both sides have an inside, both must agree.
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
    /// Contacts are written up to this distance, which is at least `contact_distance`.
    pub reported_distance: f64,
    /// The nearest pair is searched up to this distance, which is at least `reported_distance`.
    pub range: f64,
    /// By how much the distances are [wider](Self::widened) than those that count for patches. 0 for flat triangles.
    pub bulge: f64,
    /// World length of one unit of the pair's frame.
    pub scale: f64,
    /// Whether a faster test of eight pairs at a time comes first: a screen of features before exact tests, slabs
    /// before caps. The screen changes the time and how often the same contact is reported, never the result without
    /// [repeats](super::exact::unique::UniqueFeatures). Slabs drop pairs that caps alone would report as touching.
    pub cull: bool,
    /// Whether both sides are the same surface.
    pub same_surface: bool,
    /// Whether pairs within the range are missing among the candidates, although they are no neighbors. Each pair then
    /// reports all of its features, because the first triangles around them need not be a candidate.
    pub any_left_out: bool,
}

impl PairSettings {
    /// The same distances, for flat triangles in place of patches that may be up to `bulge` away from them. Pairs within
    /// the range count as touching, so that all of them are listed.
    #[must_use]
    pub fn widened(&self, bulge: f64) -> Self {
        Self {
            contact_distance: self.range + bulge,
            reported_distance: self.reported_distance + bulge,
            range: self.range + bulge,
            bulge,
            ..*self
        }
    }
}

/// The results for a list of pairs.
#[derive(Clone, Debug)]
pub struct FoundPairs {
    /// Touching pairs, in the order of the candidates.
    pub touching: Vec<TouchingPair>,
    /// Contacts, in the order of the candidates. Contacts of one pair are sorted by key.
    /// [Shared](CompactContact::is_shared) contacts may occur several times, under the same key, until
    /// [`UniqueFeatures`](super::exact::unique::UniqueFeatures) drops the repeats.
    pub contacts: Vec<CompactContact>,
    /// The shared contacts of the exact test. After repeats have been dropped, only vertex–face and edge–edge contacts
    /// are listed.
    pub shared: Vec<SharedContact>,
    /// Distance of the nearest pair in world units, at least 0. Infinite if none is within range. Where a thickness
    /// varies, the least sum of a distance and of what [lacks](super::mesh::thickness) there.
    pub nearest: f64,
    /// Number of pairs that reached the exact test.
    pub examined: usize,
    /// For each candidate of the exact test, in their order, a lower bound of its distance in the unit of the pair's
    /// frame, rounded down. For separate triangles this is the distance except for rounding, even beyond the range.
    /// Only if [requested](Self::wants_lower_bounds).
    pub lower_bounds: Vec<f32>,
    /// Whether lower bounds are requested. Defaults to false.
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
    /// Clears the lists and keeps their memory.
    pub fn clear(&mut self) {
        self.touching.clear();
        self.contacts.clear();
        self.shared.clear();
        self.nearest = f64::INFINITY;
        self.examined = 0;
        self.lower_bounds.clear();
    }

    /// Appends the results of a later part of a sorted list of pairs of faces. A pair on both sides of the cut has one
    /// contact.
    pub fn append_sorted(&mut self, later: &mut Self) {
        if let (Some(last), Some(first)) = (self.contacts.last(), later.contacts.first())
            && last.key == first.key
        {
            later.contacts.remove(0);
        }
        self.append(later);
    }

    /// Sorts the contacts of each pair from index `first` on by key, and lists the shared ones. The pairs must already
    /// be in order, and the contacts before `first` listed.
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
            // Entries that are not shared get overwritten: a branch on it would be unpredictable.
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

    /// Lists the shared contacts that have sides, once each feature pair has one contact.
    pub(crate) fn list_shared(&mut self) {
        self.shared.clear();
        let listed = (0..).zip(&self.contacts).filter(|(_, contact)| contact.is_shared && contact.key.has_sides());
        self.shared.extend(listed.map(|(place, contact)| SharedContact { key: contact.key, place }));
    }

    /// Sorts touching pairs by their triangles, given that they are in the order of the contacts. In a self-collision,
    /// contacts of spheres are sorted by the lower triangle, whichever comes first.
    pub(crate) fn sort_touching(&mut self) {
        let place = |pair: &TouchingPair| (pair.triangle_a, pair.triangle_b);
        if !self.touching.is_sorted_by_key(place) {
            self.touching.sort_unstable_by_key(place);
        }
    }

    /// Appends the results of a later part of the candidates.
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

/// Whether a contact belongs after another one of the same triangles.
#[inline]
fn is_later_of_pair(one: &CompactContact, other: &CompactContact) -> bool {
    (one.key > other.key) & (one.triangles() == other.triangles())
}
