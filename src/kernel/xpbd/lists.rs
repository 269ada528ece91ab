//! Contacts of every kind: how they are sorted when they are found, and the order in which they are solved.

use glam::DVec3;

use super::{
    acting::Evaluation,
    coloring::{Coloring, in_order},
    contacts::{At, Contact, ContactBlocks, ContactList, FeatureBlock, FeatureParticles, Plane, PlaneBlock},
    features::FeatureKind,
    rows::MovingRows,
};

/// The number of contacts that are colored together.
const BATCH: usize = 2048;

/// The number of kinds of contacts, and of those between features, which come first.
const KINDS: usize = 8;
const FEATURE_KINDS: usize = 5;

/// Contacts in the order in which they are solved, as they were found. Where constraints cannot move all particles, they
/// need not look at the others, so each case is a kind of its own.
#[derive(Debug, Default)]
pub struct FoundContacts {
    /// Of a vertex and a face, both free, or partly so.
    vertex_face: Vec<Contact<FeatureParticles>>,
    /// Of a free vertex, and a face that is not.
    vertices: Vec<Contact<FeatureParticles>>,
    /// Of a free face, and a vertex that is not.
    faces: Vec<Contact<FeatureParticles>>,
    /// Of two edges, both free, or partly so.
    edge_edge: Vec<Contact<FeatureParticles>>,
    /// Of a free edge, the first, and one that is not.
    edges: Vec<Contact<FeatureParticles>>,
    /// Of one particle.
    points: Vec<Contact<Plane<1>>>,
    /// Of up to three.
    planes: Vec<Contact<Plane<3>>>,
    /// Of up to six.
    wide_planes: Vec<Contact<Plane<6>>>,
    /// How many there were of each kind when a batch ended.
    batches: Vec<[usize; KINDS]>,
    count: usize,
}

impl FoundContacts {
    pub fn clear(&mut self) {
        let Self { vertex_face, vertices, faces, edge_edge, edges, points, planes, wide_planes, batches, count } = self;
        for list in [vertex_face, vertices, faces, edge_edge, edges] {
            list.clear();
        }
        points.clear();
        planes.clear();
        wide_planes.clear();
        batches.clear();
        *count = 0;
    }

    fn counts(&self) -> [usize; KINDS] {
        let Self { vertex_face, vertices, faces, edge_edge, edges, points, planes, wide_planes, .. } = self;
        let [a, b, c, d, e] = [vertex_face, vertices, faces, edge_edge, edges].map(Vec::len);
        [a, b, c, d, e, points.len(), planes.len(), wide_planes.len()]
    }

    /// The number of contacts.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn end_of_one(&mut self) {
        self.count += 1;
        if self.count.is_multiple_of(BATCH) {
            self.batches.push(self.counts());
        }
    }

    /// Ends a batch that has begun.
    fn end_batch(&mut self) {
        let counts = self.counts();
        let ended = self.batches.last().copied().unwrap_or_default();
        if counts != ended {
            self.batches.push(counts);
        }
    }

    /// Adds a contact of a vertex, the first particle, and a face, or of two edges. Constraints move those particles
    /// that `is_free` says.
    pub fn push_features<P>(
        &mut self,
        (kind, parts): (FeatureKind, &FeatureParticles),
        contact: &Contact<P>,
        is_free: impl Fn(u32) -> bool,
    ) {
        let [a, b, c, d] = parts.map(is_free);
        let (mut parts, mut normal) = (*parts, contact.normal);
        let list = match kind {
            FeatureKind::VertexFace if !(b || c || d) => &mut self.vertices,
            FeatureKind::VertexFace if !a => &mut self.faces,
            FeatureKind::VertexFace => &mut self.vertex_face,
            FeatureKind::EdgeEdge if !(a || b) => {
                parts = [parts[2], parts[3], parts[0], parts[1]];
                normal = -normal;
                &mut self.edges
            }
            FeatureKind::EdgeEdge if !(c || d) => &mut self.edges,
            FeatureKind::EdgeEdge => &mut self.edge_edge,
        };
        list.push(Contact { normal, ..contact.between(parts) });
        self.end_of_one();
    }

    /// Adds a contact whose plane is fixed.
    pub fn push_plane(&mut self, contact: &Contact<Plane<6>>) {
        if let Some(contact) = contact.narrowed::<1>() {
            self.points.push(contact);
        } else if let Some(contact) = contact.narrowed::<3>() {
            self.planes.push(contact);
        } else {
            self.wide_planes.push(*contact);
        }
        self.end_of_one();
    }
}

/// Contacts of every kind, colored.
///
/// Consecutive contacts are colored in batches, which are solved in order and back. So a stack whose contacts come in
/// the order of its layers is solved from layer to layer. Contacts that are found later in the tick are further batches.
#[derive(Debug, Default)]
pub struct Contacts {
    batches: usize,
    vertex_face: ContactBlocks<FeatureBlock<false, 4>, 4>,
    vertices: ContactBlocks<FeatureBlock<false, 1>, 1>,
    faces: ContactBlocks<FeatureBlock<false, 3>, 3>,
    edge_edge: ContactBlocks<FeatureBlock<true, 4>, 4>,
    edges: ContactBlocks<FeatureBlock<true, 2>, 2>,
    points: ContactBlocks<PlaneBlock<1>, 1>,
    planes: ContactBlocks<PlaneBlock<3>, 3>,
    wide_planes: ContactBlocks<PlaneBlock<6>, 6>,
}

impl Contacts {
    pub fn clear(&mut self) {
        self.batches = 0;
        self.lists().into_iter().for_each(ContactList::clear);
    }

    /// Takes over those contacts that it has not yet. Constraints move those particles that `is_free` says.
    pub fn extend(
        &mut self,
        found: &mut FoundContacts,
        is_free: impl Fn(u32) -> bool,
        coloring: &mut Coloring,
        at: &At<'_>,
    ) {
        found.end_batch();
        let (old, new) = found.batches.split_at(self.batches);
        if new.is_empty() {
            return;
        }
        self.batches = found.batches.len();
        let before = old.last().copied().unwrap_or_default();
        let new =
            |kind: usize| [&before].into_iter().chain(new).zip(new).map(move |(first, end)| first[kind]..end[kind]);
        self.vertex_face.extend(&found.vertex_face, new(0), &is_free, coloring, at);
        self.vertices.extend(&found.vertices, new(1), &is_free, coloring, at);
        self.faces.extend(&found.faces, new(2), &is_free, coloring, at);
        self.edge_edge.extend(&found.edge_edge, new(3), &is_free, coloring, at);
        self.edges.extend(&found.edges, new(4), &is_free, coloring, at);
        self.points.extend(&found.points, new(5), &is_free, coloring, at);
        self.planes.extend(&found.planes, new(6), &is_free, coloring, at);
        self.wide_planes.extend(&found.wide_planes, new(7), &is_free, coloring, at);
    }

    fn lists(&mut self) -> [&mut dyn ContactList; KINDS] {
        let Self { vertex_face, vertices, faces, edge_edge, edges, points, planes, wide_planes, .. } = self;
        [vertex_face, vertices, faces, edge_edge, edges, points, planes, wide_planes]
    }

    fn visit(&mut self, kinds: usize, is_backward: bool, mut solve: impl FnMut(&mut dyn ContactList, usize)) {
        for batch in in_order(self.batches, is_backward) {
            let mut lists = self.lists();
            in_order(kinds, is_backward).for_each(|kind| solve(&mut *lists[kind], batch));
        }
    }

    /// Evaluates all contacts at the unconstrained positions of a substep.
    pub fn begin_step(&mut self, rows: MovingRows<'_>, evaluation: Evaluation) {
        self.lists().into_iter().for_each(|list| list.begin_step(rows, evaluation));
    }

    /// Pushes by a share of the last substep's push.
    pub fn push_again(&mut self, rows: MovingRows<'_>) {
        self.lists().into_iter().for_each(|list| list.push_again(rows));
    }

    /// Pushes the sides of all contacts apart to their target separations, in order, or backward.
    pub fn separate(&mut self, rows: MovingRows<'_>, is_backward: bool) {
        self.visit(KINDS, is_backward, |list, batch| list.separate(batch, rows, is_backward));
    }

    /// Holds the sides of all contacts along the surface, within the limits of friction, in order, or backward.
    pub fn rub(&mut self, rows: MovingRows<'_>, is_backward: bool) {
        self.visit(KINDS, is_backward, |list, batch| list.rub(batch, rows, is_backward));
    }

    /// Pushes the sides of contacts of features apart once more that are still too near after friction, in order or
    /// backward. Not planes: they are not evaluated again within a tick, and some lead out of something at their own pace.
    pub fn recover(&mut self, rows: MovingRows<'_>, is_backward: bool) {
        self.visit(FEATURE_KINDS, is_backward, |list, batch| list.recover(batch, rows, is_backward));
    }

    /// Ends a substep, after velocities have been derived: keeps what is left, and removes bounce.
    pub fn end_step(&mut self, rows: MovingRows<'_>) {
        self.lists().into_iter().for_each(|list| list.end_step(rows));
    }

    /// Calls `visit` with the number and the normal of every contact that may act and asks for its impulse. Adds what that
    /// returns, if anything, to the contact's sums of inverse masses, along the normal and across.
    pub fn soften(&mut self, mut visit: impl FnMut(u32, DVec3) -> Option<[f64; 2]>) {
        self.lists().into_iter().for_each(|list| list.soften(&mut visit));
    }

    /// Calls `add` with the number of every contact that asks for its impulse, and with what it pushes in this substep on its
    /// first side, times the duration of the substep. `is_over` says whether the substep has ended.
    pub fn pushes(&mut self, is_over: bool, mut add: impl FnMut(u32, DVec3)) {
        self.lists().into_iter().for_each(|list| list.pushes(is_over, &mut add));
    }

    /// Calls `add` with the number of every contact that asks for its impulse, and with the sum of its multipliers in all
    /// substeps: the impulse on its first side, times the duration of a substep.
    pub fn reactions(&mut self, mut add: impl FnMut(u32, DVec3)) {
        self.lists().into_iter().for_each(|list| list.reactions(&mut add));
    }

    /// The number of contacts that may act in this substep, and of those that press.
    #[must_use]
    pub fn counts(&mut self) -> [usize; 2] {
        let counts = self.lists().map(|list| list.counts());
        counts.into_iter().fold([0; 2], |[acting, pressing], [a, p]| [acting + a, pressing + p])
    }
}

#[cfg(test)]
mod tests {
    use circumsphere_support::random::Random;

    use super::*;
    use crate::kernel::{
        simd::parallel::Sequential,
        xpbd::{MOST_LEVER, ParticleRows, Placed, coloring::NONE},
    };

    const EVALUATION: Evaluation = Evaluation { step: 0.01, push_out: 1.0, share: 1.0, rate: 100.0 };

    /// Where four particles end that are pushed apart, rub, and lose their bounce.
    fn solved(contact: impl Fn(&mut FoundContacts), start: &[DVec3; 4], placed: [Placed; 4]) -> [[DVec3; 2]; 4] {
        let (mut found, mut contacts, mut rows) =
            (FoundContacts::default(), Contacts::default(), ParticleRows::default());
        contact(&mut found);
        rows.begin(placed.into_iter());
        let is_free = |particle: u32| placed[particle as usize].inverse_mass > 0.0;
        let moving = rows.moving();
        let at = At { start: moving.starts(start), rows: moving, share: 0.0 };
        contacts.extend(&mut found, is_free, &mut Coloring::default(), &at);
        rows.predict(&Sequential, EVALUATION.step, glam::Vec3::ZERO, 1.0);
        contacts.begin_step(rows.moving(), EVALUATION);
        contacts.push_again(rows.moving());
        contacts.separate(rows.moving(), false);
        contacts.separate(rows.moving(), true);
        contacts.rub(rows.moving(), false);
        rows.update_velocities(&Sequential, EVALUATION.step);
        contacts.end_step(rows.moving());
        std::array::from_fn(|particle| rows.state(particle))
    }

    /// The least distance of the features along their first direction is kept, and what need not look at kinematic
    /// particles does the same as what looks at all of them.
    #[test]
    fn kinds_for_kinematic_sides_do_what_the_general_ones_do() {
        let mut random = Random::new(23);
        let mut pressed = 0;
        for case in 0..400 {
            let mut vector =
                |size: f64| DVec3::from_array(std::array::from_fn(|_| size * f64::from(random.signed_unit())));
            let kind = if case % 2 == 0 { FeatureKind::VertexFace } else { FeatureKind::EdgeEdge };
            let flat = match kind {
                FeatureKind::VertexFace => [[0.2, 0.3], [0.0, 0.0], [1.0, 0.1], [0.1, 1.0]],
                FeatureKind::EdgeEdge => [[-0.8, 0.1], [0.9, 0.2], [0.1, -0.7], [0.2, 0.9]],
            };
            let is_first = |place: usize| place < if kind == FeatureKind::VertexFace { 1 } else { 2 };
            let start: [DVec3; 4] = std::array::from_fn(|place| {
                let height = if is_first(place) { 0.1 } else { 0.0 };
                DVec3::new(flat[place][0], height, flat[place][1]) + vector(0.02)
            });
            // The first side, or the second, is free.
            let placed: [Placed; 4] = std::array::from_fn(|place| {
                let is_free = is_first(place) == (case % 4 < 2);
                let toward = if is_first(place) { DVec3::NEG_Y } else { DVec3::Y };
                let speed = toward * 4.0 + vector(2.0);
                Placed {
                    way: if is_free { DVec3::ZERO } else { speed * f64::from(EVALUATION.step) },
                    velocity: if is_free { speed } else { DVec3::ZERO },
                    inverse_mass: if is_free { 1.0 + 0.5 * place as f64 } else { 0.0 },
                }
            });
            let contact = Contact {
                parts: [0, 1, 2, 3],
                normal: DVec3::Y,
                distance: 0.08,
                friction: [0.5, 0.4],
                reaction: NONE,
                recovers: false,
            };
            let is_free = |particle: u32| placed[particle as usize].inverse_mass > 0.0;
            let narrow = solved(|found| found.push_features((kind, &contact.parts), &contact, is_free), &start, placed);
            let general =
                solved(|found| found.push_features((kind, &contact.parts), &contact, |_| true), &start, placed);
            for (narrow, general) in narrow.into_iter().zip(general) {
                assert!(narrow[0].distance(general[0]) < 1e-5, "{case} {kind:?}: {narrow:?} {general:?}");
                assert!(narrow[1].distance(general[1]) < 1e-3, "{case} {kind:?}: {narrow:?} {general:?}");
            }
            let free = solved(|_| {}, &start, placed);
            pressed += usize::from((0..4).any(|place| free[place][0].distance(narrow[place][0]) > 1e-3));
        }
        assert!(pressed > 200, "only {pressed} contacts press");
    }

    #[test]
    fn a_plane_that_moves_carries_what_lies_on_it() {
        // A point on a plane that rises by 5 mm and moves sideways by 2 mm in the tick, with much friction.
        let point = Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: 2.0 };
        let drive = DVec3::new(0.002, 0.005, 0.0);
        let parts = Plane {
            particles: [0, NONE, NONE, NONE, NONE, NONE],
            weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            drive: -drive,
            separation: 0.0,
        };
        let contact =
            Contact { parts, normal: DVec3::Y, distance: 0.01, friction: [5.0, 5.0], reaction: NONE, recovers: false };
        let ends = solved(|found| found.push_plane(&contact), &[DVec3::ZERO; 4], [point; 4]);
        assert!(ends[0][0].distance(drive) < 1e-7, "{:?}", ends[0]);
        assert!(ends[0][1].distance(drive / f64::from(EVALUATION.step)) < 1e-4, "{:?}", ends[0]);
        assert_eq!(ends[1], [DVec3::ZERO; 2]);
    }

    /// A kinematic vertex presses on a face right beside one of its two pinned corners. What is left to the free corner would
    /// have to move by the depth divided by its weight.
    #[test]
    fn what_presses_beside_a_pinned_vertex_throws_nothing_away() {
        let depth = 0.01;
        let pinned = Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: 0.0 };
        for share in [0.5, 0.05, 1e-3, 1e-6, 1e-12, 1e-18] {
            let start = [DVec3::new(0.0, depth, share), DVec3::ZERO, DVec3::X, DVec3::Z];
            let free = Placed { inverse_mass: 3.0, ..pinned };
            let contact = Contact {
                parts: [0, 1, 2, 3],
                normal: DVec3::Y,
                distance: 2.0 * depth,
                friction: [0.5, 0.4],
                reaction: NONE,
                recovers: false,
            };
            let add = |found: &mut FoundContacts| {
                found.push_features((FeatureKind::VertexFace, &contact.parts), &contact, |particle| particle == 3);
            };
            let ends = solved(add, &start, [pinned, pinned, pinned, free]);
            let way = ends[3][0].length();
            assert!(way <= 1.01 * depth * f64::from(MOST_LEVER), "{share}: {way}");
            assert!(share < 0.2 || (way * share - depth).abs() < 1e-4, "where there is leverage, it parts: {way}");
        }
    }
}
