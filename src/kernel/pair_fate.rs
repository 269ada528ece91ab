//! At which step a pair of triangles whose boxes overlap was dropped.
//!
//! No stage records it: whoever asks runs the stages' own functions once more, and hears from them after each step which
//! pairs are left. So the answer is that of the stages, and costs nothing where nobody asks. Read by
//! `detection::PairFates`, which adds what slabs have dropped before there were candidates.

use glam::Vec3;

use super::{
    exact::rigid_shape::ShapeGeometry,
    pair::{FoundPairs, PairSettings, SurfaceSide, without_neighbors},
    pose::Pose,
    refine::{refine_closest, refine_shape},
    sphere_contacts::{ball_contacts, meeting_caps},
    sphere_pairs::{BallSide, CapSide, overlapping_balls_in_steps, overlapping_caps_in_steps},
    topology::SurfaceTopology,
};

/// What became of a pair whose boxes overlap: the step that dropped it, in the order in which the methods take them, or that
/// it touches. Each method takes some of the steps; a rigid shape is only measured ([`Distance`](Self::Distance)).
///
/// What *matters* is the contact distance, or more where a margin or the end of contacts asks for it
/// ([`SurfacePair::range`](crate::detection::SurfacePair::range)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PairFate {
    /// The two share a vertex in a self-collision. The broad phases of this crate leave such pairs out already.
    Neighbors,
    /// What is remembered of the distance of the two, less what their surfaces have moved since, exceeds what matters, or
    /// else a slab still keeps them farther apart: they were passed over. `Refined` and `Closest`, where surfaces have [moved a
    /// little](field@crate::CircumsphereSettings::memory); of such surfaces' other pairs whose boxes may overlap nothing is
    /// known.
    Remembered,
    /// A slab keeps the two farther apart than matters: along the normal of one of them or, with `Refined` and `Closest`,
    /// along one of some directions from one to the other, of which the first is the line between their centroids. The
    /// broad phase by trees drops such pairs before they are candidates. After one that does not, `Circumsphere` drops
    /// those of the normals; `Refined` and `Closest` measure them ([`Distance`](Self::Distance)). `Circumsphere` only
    /// with [`plane_cull`](crate::CircumsphereSettings::plane_cull); not `BoundingSphere` and `Polygon`.
    Planes,
    /// The spheres of the two are farther apart than matters: their enclosing balls (`BoundingSphere`), or the offset
    /// spheres (`Circumsphere`).
    Spheres,
    /// Along the line between the centers of their offset spheres the two are farther apart than matters.
    /// `Circumsphere` with [`plane_cull`](crate::CircumsphereSettings::plane_cull).
    CenterLine,
    /// The line between the centers of their offset spheres leaves one of them outside its safety cone: as far as
    /// the method knows, it is not the surface that is met there. `Circumsphere`, and the step at which that method misses
    /// pairs that touch.
    Cone,
    /// Farther apart than the contact distance, as far as the method measures it. Any method. Within the
    /// [margin](field@crate::CircumsphereSettings::margin) such a pair still has contacts.
    Distance,
    /// Within the contact distance.
    Touching,
}

impl PairFate {
    /// All of them, in order.
    pub const ALL: [Self; 8] = [
        Self::Neighbors,
        Self::Remembered,
        Self::Planes,
        Self::Spheres,
        Self::CenterLine,
        Self::Cone,
        Self::Distance,
        Self::Touching,
    ];

    /// A short name in lower case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Neighbors => "neighbors",
            Self::Remembered => "remembered",
            Self::Planes => "planes",
            Self::Spheres => "spheres",
            Self::CenterLine => "center line",
            Self::Cone => "cone",
            Self::Distance => "distance",
            Self::Touching => "touching",
        }
    }
}

/// Hears after each step of a method which candidates are left, in their order.
pub(super) trait StepObserver {
    /// Whether anybody hears: else steps may be taken together, in whatever order is fastest.
    const ASKS: bool;

    /// `step` has been taken, and `left` are the pairs that it did not drop.
    fn passed(&mut self, step: PairFate, left: impl Iterator<Item = [u32; 2]>);
}

/// Nobody asks: what the stages pass, for which nothing is computed.
pub(super) struct Unobserved;

impl StepObserver for Unobserved {
    const ASKS: bool = false;

    fn passed(&mut self, _: PairFate, _: impl Iterator<Item = [u32; 2]>) {}
}

/// The fates of a list of candidates, as far as the steps have been taken.
struct Fates<'a> {
    candidates: &'a [[u32; 2]],
    fates: &'a mut [PairFate],
}

impl<'a> Fates<'a> {
    /// Appends a fate for each candidate, to be settled by the steps.
    fn append(candidates: &'a [[u32; 2]], fates: &'a mut Vec<PairFate>) -> Self {
        let before = fates.len();
        fates.resize(before + candidates.len(), PairFate::Touching);
        Self { candidates, fates: &mut fates[before..] }
    }
}

impl StepObserver for Fates<'_> {
    const ASKS: bool = true;

    fn passed(&mut self, step: PairFate, left: impl Iterator<Item = [u32; 2]>) {
        let mut left = left.peekable();
        for (candidate, fate) in self.candidates.iter().zip(&mut *self.fates) {
            // A pair that is listed twice passes twice, or not at all: the next one left is a candidate's own, or later.
            if *fate == PairFate::Touching && left.next_if_eq(candidate).is_none() {
                *fate = step;
            }
        }
        debug_assert!(left.next().is_none(), "{step:?} passed on what it was not given");
    }
}

fn touching(found: &FoundPairs) -> impl Iterator<Item = [u32; 2]> {
    found.touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b])
}

/// Appends the fate of each candidate by the method `BoundingSphere`.
pub fn ball_fates(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let (mut overlapping, mut found) = (Vec::new(), FoundPairs::default());
    overlapping_balls_in_steps(a, b, candidates, settings, &mut overlapping, &mut fates);
    ball_contacts(a, b, &overlapping, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate by the method `Circumsphere`.
pub fn cap_fates(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let (mut overlapping, mut meeting, mut found) = (Vec::new(), Vec::new(), FoundPairs::default());
    overlapping_caps_in_steps(a, b, candidates, settings, &mut overlapping, &mut fates);
    meeting_caps(a, b, &overlapping, settings, &mut meeting, &mut found);
    fates.passed(PairFate::Cone, meeting.iter().copied());
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate by the methods that are exact. What slabs part the broad phase has dropped before.
pub fn exact_fates(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut found = FoundPairs::default();
    fates.passed(PairFate::Neighbors, without_neighbors(a, candidates, settings).iter().copied());
    refine_closest(a, b, candidates, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}

/// Appends the fate of each candidate triangle near a rigid shape; see [`refine_shape`] for what they are of.
pub fn shape_fates(
    topology: &SurfaceTopology,
    positions: &[Vec3],
    pose: &Pose,
    shape: &ShapeGeometry,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    fates: &mut Vec<PairFate>,
) {
    let mut fates = Fates::append(candidates, fates);
    let mut found = FoundPairs::default();
    refine_shape(topology, positions, pose, shape, candidates, settings, &mut found);
    fates.passed(PairFate::Distance, touching(&found));
}
