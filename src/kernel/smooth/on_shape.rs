//! Tests the patches of a smooth surface against a rigid shape.
//!
//! The exact test of the flat triangle, with a range that is wider by the height of the patch, says where to begin. The
//! signed distance of the shape over the patch is a smooth function of two weights, except at kinks inside the shape.
//! Newton steps within the triangle find its minimum: each minimizes the second-order model exactly, over the inside,
//! the edges, and the corners. A patch that bends away from the shape may have several minima, so more searches begin at
//! the middles of its edges. The least minimum is a contact, and the contacts of the flat triangle move along with their
//! points.

use glam::{DVec2, DVec3};

use super::patch::{Local, Patch, PatchPart};
use crate::kernel::{
    exact::{
        PairProximity,
        rigid_shape::{Nearness, ShapeFoot, ShapeGeometry, ShapeProximity, shape_pairs, test_each},
    },
    mesh::{barycentric::point_at, feature::Feature, thickness::lack_at},
    pair::{FoundPairs, PairSettings, SurfaceSide},
};

/// The most steps.
const STEPS: usize = 32;

/// Steps that do not come closer are halved this often.
const HALVINGS: usize = 24;

/// The model is right if a step comes closer by at least this share of what it expects.
const GOOD_GAIN: f64 = 0.5;

/// Steps that shorten the distance by less than this share of the patch's size end the search.
const LEAST_GAIN: f64 = 1.0e-9;

/// A weight below this is 0: the point is on the edge opposite the corner.
const ON_BORDER: f64 = 1.0e-9;

/// A contact at an edge counts if the patch beside it falls toward the shape by no more than this sine. Otherwise the
/// patch is closer farther in.
const FACING: f64 = 0.02;

/// What lacks at the corners of a triangle whose thickness is the same everywhere.
const EVEN: [f64; 3] = [0.0; 3];

/// The middles of the edges, by weights.
const MIDDLES: [[f64; 3]; 3] = [[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]];

/// Memory for tests of single patches.
#[derive(Default)]
pub struct PatchScratch {
    pair: PairProximity,
    on_tangents: Vec<ShapeProximity>,
    of_triangle: Vec<ShapeProximity>,
}

impl PatchScratch {
    /// Where a patch is closest to a shape, or deepest in it. `None` if they are farther apart than `range`.
    ///
    /// From where the triangle is closest, the search leads to a place where the patch is closest nearby, which need not be
    /// the closest of all.
    pub fn closest(&mut self, patch: &Patch, shape: &ShapeGeometry, range: f64) -> Option<ShapeProximity> {
        self.nearby(patch, shape, range).map(|place| place.proximity(patch))
    }

    /// Like [`closest`](Self::closest), and no other place is closer by a quarter of the distance and by more than `slack`.
    pub fn closest_of_all(
        &mut self,
        patch: &Patch,
        shape: &ShapeGeometry,
        range: f64,
        slack: f64,
    ) -> Option<ShapeProximity> {
        let mut place = self.nearby(patch, shape, range)?;
        loop {
            let distance = place.foot.distance;
            let closer = (distance > slack).then(|| distance - slack.max(0.25 * distance));
            let closer = closer.and_then(|closer| closer_than(&PatchPart::whole(*patch), shape, closer));
            let Some(start) = closer else { return Some(place.proximity(patch)) };
            let Self { pair, on_tangents, .. } = self;
            place = Search { patch, shape, lacks: EVEN, scratch: pair, on_tangents }.descend(start);
        }
    }

    /// Whether a patch shares a point with a shape.
    pub fn overlaps(&mut self, patch: &Patch, shape: &ShapeGeometry) -> bool {
        self.nearby(patch, shape, patch.height()).is_some_and(|place| place.foot.distance <= 0.0)
            || self.part_overlaps(&PatchPart::whole(*patch), shape)
    }

    /// Like [`overlaps`](Self::overlaps), for a part of a patch. Small ones count as flat: a shape without volume has no point
    /// in it that could be found.
    fn part_overlaps(&mut self, part: &PatchPart, shape: &ShapeGeometry) -> bool {
        let Reach { distance, nearest } = Reach::of(part, shape);
        if distance <= 0.0 || nearest > 0.0 {
            return distance <= 0.0;
        }
        if part.size() < FLAT_PART {
            self.of_triangle.clear();
            return shape.examine(&part.patch.corners, 0.0, &mut self.pair, &mut self.of_triangle) <= 0.0;
        }
        part.halved().iter().any(|part| self.part_overlaps(part, shape))
    }

    fn nearby(&mut self, patch: &Patch, shape: &ShapeGeometry, range: f64) -> Option<Place> {
        let Self { pair, on_tangents, of_triangle } = self;
        of_triangle.clear();
        shape.examine(&patch.corners, range + patch.height(), pair, of_triangle);
        let place = (!of_triangle.is_empty())
            .then(|| Search { patch, shape, lacks: EVEN, scratch: pair, on_tangents }.nearest(of_triangle));
        place.filter(|place| place.foot.distance <= range)
    }
}

/// Parts of a patch that are smaller than this, by their weights, are not searched for a place any more.
const LEAST_PART: f64 = 1.0 / 512.0;

/// Parts of a patch that are smaller than this, by their weights, are as good as flat.
const FLAT_PART: f64 = 1.0 / 128.0;

/// The distance of a shape from a part of a patch.
struct Reach {
    /// At its center.
    distance: f64,
    /// A lower bound everywhere. The distance changes by no more than a point moves.
    nearest: f64,
}

impl Reach {
    const CENTER: [f64; 3] = [1.0 / 3.0; 3];

    fn of(part: &PatchPart, shape: &ShapeGeometry) -> Self {
        let center = part.patch.point(&Self::CENTER);
        let distance = shape.foot(center).distance;
        let to_corners = part.patch.corners.iter().fold(0.0_f64, |most, corner| most.max(corner.distance(center)));
        // Its points are between its corners, or above that by at most its height.
        Self { distance, nearest: distance - to_corners - part.patch.height() }
    }
}

/// The weights of a place of a patch that is within `distance` of a shape, if one is found.
fn closer_than(part: &PatchPart, shape: &ShapeGeometry, distance: f64) -> Option<[f64; 3]> {
    let reach = Reach::of(part, shape);
    if reach.distance <= distance {
        return Some(part.in_whole(&Reach::CENTER));
    }
    if reach.nearest > distance || part.size() < LEAST_PART {
        return None;
    }
    part.halved().iter().find_map(|part| closer_than(part, shape, distance))
}

/// Like [`shape_pairs`], for the patches of a smooth surface, and for triangles of different thickness.
pub fn patch_shape_pairs(
    side: &SurfaceSide<'_>,
    shape: &ShapeGeometry,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    if side.curved.is_none() && side.is_evenly_thick() {
        return shape_pairs(side, shape, candidates, settings, found);
    }
    let (mut scratch, mut on_tangents) = (PairProximity::default(), Vec::new());
    let range = settings.range / settings.scale;
    test_each(side, candidates, settings, found, |triangle, proximities| {
        let patch = Patch::of(side, triangle);
        let height = side.patch_height(triangle);
        let mut distance = shape.examine(&patch.corners, range + height, &mut scratch, proximities);
        if height > 0.0 && !proximities.is_empty() {
            distance = refine(&patch, shape, (&mut scratch, &mut on_tangents), proximities);
        }
        let lacks = side.lacks(triangle).map(|lack| lack / settings.scale);
        if lacks[0] == lacks[1] && lacks[0] == lacks[2] || proximities.is_empty() {
            return Nearness { reach: distance + lacks[0], distance };
        }
        let search = Search { patch: &patch, shape, lacks, scratch: &mut scratch, on_tangents: &mut on_tangents };
        Nearness { reach: add_thickest(search, proximities), distance }
    });
}

/// Adds the place where the distance and what lacks are least together, if it is outside the shape. Returns their sum.
fn add_thickest(mut search: Search<'_>, proximities: &mut Vec<ShapeProximity>) -> f64 {
    let nearest = search.nearest(proximities);
    let lacks = search.lacks;
    if nearest.foot.distance > 0.0 {
        let own = nearest.proximity(search.patch);
        proximities.retain(|other| (other.feature, other.shape_feature) != (own.feature, own.shape_feature));
        proximities.push(own);
    }
    let reaches = proximities.iter().map(|found| found.distance + lack_at(&lacks, &found.barycentric));
    reaches.fold(nearest.reach, f64::min)
}

/// Moves proximities of the flat triangle to its patch, adds the closest place, and returns the distance there.
fn refine(
    patch: &Patch,
    shape: &ShapeGeometry,
    (scratch, on_tangents): (&mut PairProximity, &mut Vec<ShapeProximity>),
    proximities: &mut Vec<ShapeProximity>,
) -> f64 {
    let nearest = Search { patch, shape, lacks: EVEN, scratch, on_tangents }.nearest(proximities);
    let is_apart = nearest.foot.distance > 0.0;
    proximities.retain_mut(|proximity| {
        // Whether surfaces cross is decided by the patch.
        if proximity.crossing {
            return !is_apart;
        }
        if matches!(proximity.feature, Feature::Vertex(_)) {
            return true;
        }
        let point = patch.point(&proximity.barycentric);
        let foot = shape.foot(point);
        if foot.distance > 0.0 {
            (proximity.normal, proximity.distance) = (foot.normal, foot.distance);
            proximity.shape_point = point - foot.normal * foot.distance;
        } else {
            // Inside, the way out need not be that of the point.
            let moved = point - point_at(&patch.corners, &proximity.barycentric);
            let rise = proximity.normal.dot(moved);
            proximity.distance += rise;
            proximity.shape_point += moved - proximity.normal * rise;
        }
        proximity.distance <= 0.0 || faces(patch, proximity)
    });
    let own = nearest.proximity(patch);
    // Inside, an edge or a face that cuts through the shape has a way out of its own, which is not that of its points.
    let has_way_out =
        |other: &ShapeProximity| other.crossing || other.distance < 0.0 && !matches!(other.feature, Feature::Vertex(_));
    if is_apart || !proximities.iter().any(has_way_out) {
        let out = if is_apart { Some(own) } else { shape.led_out(patch.point(&own.barycentric), own) };
        if let Some(out) = out {
            proximities.retain(|other| (other.feature, other.shape_feature) != (out.feature, out.shape_feature));
            proximities.push(out);
        }
    }
    closest_of(proximities).map_or(own.distance, |closest| closest.distance.min(own.distance))
}

/// The proximity with the least distance.
fn closest_of(proximities: &[ShapeProximity]) -> Option<&ShapeProximity> {
    proximities.iter().min_by(|one, other| one.distance.total_cmp(&other.distance))
}

/// Whether the patch beside an edge rises from the shape.
fn faces(patch: &Patch, proximity: &ShapeProximity) -> bool {
    let Feature::Edge(edge) = proximity.feature else { return true };
    let Local { tangents: [second, third], .. } = patch.local(&proximity.barycentric);
    // From each edge to the corner opposite it, and along the edge.
    let (inward, along) = match edge % 3 {
        0 => (third, second),
        1 => (-second, third - second),
        _ => (second, third),
    };
    let inward = inward.reject_from(along);
    proximity.normal.dot(inward) >= -FACING * inward.length()
}

/// A point of a patch, and the distance of a shape there.
struct Place {
    weights: [f64; 3],
    foot: ShapeFoot,
    /// The distance, and what lacks there.
    reach: f64,
}

/// A search for the place of a patch where the distance and what lacks are least together.
struct Search<'a> {
    patch: &'a Patch,
    shape: &'a ShapeGeometry,
    /// What lacks at the corners, in the unit of the pair's frame.
    lacks: [f64; 3],
    scratch: &'a mut PairProximity,
    on_tangents: &'a mut Vec<ShapeProximity>,
}

impl Search<'_> {
    /// The place where the patch is closest, given those of its triangle.
    fn nearest(&mut self, proximities: &[ShapeProximity]) -> Place {
        let start = closest_of(proximities).map_or([1.0, 0.0, 0.0], |closest| closest.barycentric);
        let mut nearest = self.descend(start);
        let others = if nearest.model(self).may_have_others() { &MIDDLES[..] } else { &[] };
        // Other parts of a compound may be closer.
        let of_parts = proximities.iter().filter(|_| matches!(self.shape, ShapeGeometry::Compound(_)));
        for start in of_parts.map(|proximity| proximity.barycentric).chain(others.iter().copied()) {
            let other = self.descend(start);
            if other.reach < nearest.reach {
                nearest = other;
            }
        }
        // The triangle may cross the shape where the patch does not, and the other way around.
        for crossing in proximities.iter().filter(|proximity| proximity.crossing) {
            if nearest.foot.distance <= 0.0 {
                break;
            }
            let other = self.descend(crossing.barycentric);
            if other.reach < nearest.reach {
                nearest = other;
            }
        }
        nearest
    }

    fn at(&self, weights: [f64; 3]) -> Place {
        let foot = self.shape.foot(self.patch.point(&weights));
        Place { weights, foot, reach: foot.distance + lack_at(&self.lacks, &weights) }
    }

    fn after(&self, place: &Place, step: DVec2) -> Place {
        let [_, second, third] = place.weights;
        let (second, third) = (second + step.x, third + step.y);
        self.at([1.0 - second - third, second, third].map(|weight| f64::max(weight, 0.0)))
    }

    fn descend(&mut self, start: [f64; 3]) -> Place {
        let least_gain = LEAST_GAIN * self.patch.size();
        let mut place = self.at(start);
        for _ in 0..STEPS {
            // Where the model has nowhere lower to go, neither has the patch.
            let Some((step, change)) = place.model(self).lowest(&place.weights) else { break };
            if change >= -least_gain {
                break;
            }
            let least = place.reach - least_gain;
            let is_lower = |next: &Place| next.reach < least;
            let next = self.step(&place, step, change).or_else(|| self.step_on_tangents(&place)).filter(is_lower);
            let Some(next) = next else { break };
            place = next;
        }
        place
    }

    /// The place after a step to where the model is lowest. `None` if the model is wrong. Inside, where nothing else
    /// helps, a part of the step will do.
    fn step(&self, place: &Place, step: DVec2, change: f64) -> Option<Place> {
        let next = self.after(place, step);
        if place.reach - next.reach > -GOOD_GAIN * change {
            return Some(next);
        }
        let has_tangents = place.foot.distance > 0.0 && self.lacks == EVEN;
        if has_tangents { None } else { self.lower(place, step * 0.5) }
    }

    /// The first lower place after a step, or after a half of it, a quarter, and so on.
    fn lower(&self, place: &Place, mut step: DVec2) -> Option<Place> {
        for _ in 0..HALVINGS {
            let next = self.after(place, step);
            if next.reach < place.reach {
                return Some(next);
            }
            step *= 0.5;
        }
        None
    }

    /// The place after a step towards where the triangle that touches the patch is closest, or a part of it. This goes
    /// down even at a kink. `None` if no place is lower.
    fn step_on_tangents(&mut self, place: &Place) -> Option<Place> {
        let distance = place.foot.distance;
        // Inside, what the test of a triangle reports is not the depth of its points.
        if distance <= 0.0 || self.lacks != EVEN {
            return None;
        }
        let Local { point, tangents: [u, v], .. } = self.patch.local(&place.weights);
        let [_, second, third] = place.weights;
        let first = point - u * second - v * third;
        self.on_tangents.clear();
        self.shape.examine(&[first, first + u, first + v], distance, self.scratch, self.on_tangents);
        let [_, to_second, to_third] = closest_of(self.on_tangents)?.barycentric;
        self.lower(place, DVec2::new(to_second - second, to_third - third))
    }
}

/// The change of the reach as the weights of the second and the third corner change, to second order.
struct Model {
    slope: DVec2,
    /// The second derivatives: twice by the second weight, by both, and twice by the third.
    bends: [f64; 3],
    /// Those of the patch alone, along the direction of the distance.
    own_bends: [f64; 3],
}

impl Place {
    fn model(&self, Search { patch, lacks, .. }: &Search<'_>) -> Model {
        let Local { tangents: [u, v], seconds: [uu, uv, vv], .. } = patch.local(&self.weights);
        let ShapeFoot { normal, bends, .. } = self.foot;
        let bend = |one: DVec3, other: DVec3| bends.iter().map(|bend| bend.dot(one) * bend.dot(other)).sum::<f64>();
        let own_bends = [normal.dot(uu), normal.dot(uv), normal.dot(vv)];
        Model {
            own_bends,
            slope: DVec2::new(normal.dot(u) + lacks[1] - lacks[0], normal.dot(v) + lacks[2] - lacks[0]),
            bends: [own_bends[0] + bend(u, u), own_bends[1] + bend(u, v), own_bends[2] + bend(v, v)],
        }
    }

    fn proximity(&self, patch: &Patch) -> ShapeProximity {
        let mut weights = self.weights.map(|weight| if weight < ON_BORDER { 0.0 } else { weight });
        let sum: f64 = weights.iter().sum();
        weights = weights.map(|weight| weight / sum);
        let feature = match weights.map(|weight| weight > 0.0) {
            [true, true, true] => Feature::Face,
            [true, true, false] => Feature::Edge(0),
            [false, true, true] => Feature::Edge(1),
            [true, false, true] => Feature::Edge(2),
            [_, true, _] => Feature::Vertex(1),
            [_, _, true] => Feature::Vertex(2),
            _ => Feature::Vertex(0),
        };
        let ShapeFoot { distance, normal, shape_feature, .. } = self.foot;
        ShapeProximity {
            feature,
            shape_feature,
            crossing: false,
            barycentric: weights,
            shape_point: patch.point(&weights) - normal * distance,
            normal,
            distance,
        }
    }
}

impl Model {
    /// Whether the patch bends away from the shape in some direction. Otherwise it is convex, and a convex shape is
    /// closest to it at one place.
    fn may_have_others(&self) -> bool {
        let [uu, uv, vv] = self.own_bends;
        uu < 0.0 || vv < 0.0 || uu * vv < uv * uv
    }

    fn change(&self, step: DVec2) -> f64 {
        let [uu, uv, vv] = self.bends;
        self.slope.dot(step) + 0.5 * (uu * step.x * step.x + vv * step.y * step.y) + uv * step.x * step.y
    }

    /// The step to where the model is lowest, from these weights and within the triangle, and the change there. `None`
    /// if it is lowest here.
    fn lowest(&self, &[_, second, third]: &[f64; 3]) -> Option<(DVec2, f64)> {
        let [uu, uv, vv] = self.bends;
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|corner| corner - DVec2::new(second, third));
        let (mut best, mut lowest) = (DVec2::ZERO, 0.0);
        let mut offer = |step: DVec2| {
            let change = self.change(step);
            if change < lowest {
                (best, lowest) = (step, change);
            }
        };
        let determinant = uu * vv - uv * uv;
        if uu > 0.0 && determinant > 0.0 {
            let step = DVec2::new(uv * self.slope.y - vv * self.slope.x, uv * self.slope.x - uu * self.slope.y);
            let step = step / determinant;
            let [x, y] = [second + step.x, third + step.y];
            if x >= 0.0 && y >= 0.0 && x + y <= 1.0 {
                offer(step);
            }
        }
        for corner in 0..3 {
            let (start, along) = (corners[corner], corners[(corner + 1) % 3] - corners[corner]);
            offer(start);
            let slope = self.slope + DVec2::new(uu * start.x + uv * start.y, uv * start.x + vv * start.y);
            let bend = uu * along.x * along.x + 2.0 * uv * along.x * along.y + vv * along.y * along.y;
            let share = -slope.dot(along) / bend;
            if bend > 0.0 && share > 0.0 && share < 1.0 {
                offer(start + along * share);
            }
        }
        (lowest < 0.0).then_some((best, lowest))
    }
}
