//! Why two triangles do not touch: the step at which each pair of the last detection was dropped.
//!
//! For debug layers, tests, and curious users, after detection. The stages record nothing. Their kernel functions run
//! once more for the requested pairs, and the traversal runs with and without slabs and normal cones to find what these
//! dropped.

use std::collections::HashSet;

use bevy_ecs::{prelude::*, system::SystemParam};

use crate::{
    detection::{
        broad_phase::{MovedLeaves, Needed, Traversal},
        exact::refine_pair,
        pairs::{CandidateTrianglePairs, OtherSide, SurfacePair},
        parallel::{Buffers, append_chunks},
        reuse::near_lists::KeptPairs,
        sides::{
            SphereQuery, SphereRows, pair_settings, side_on_shape, surface_sides, with_balls, with_caps,
            with_osculating,
        },
        state::SurfaceStates,
    },
    kernel::{
        bvh::leaf_triangles::Region,
        exact::stage::{closest_pairs, exact_pairs},
        mesh::ids::TriangleId,
        pair::{FoundPairs, SurfaceSide},
        pair_fate::{PairFate, ball_fates, cap_fates, exact_fates, osculating_fates, shape_fates},
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactFilter, ContactMethod, PairFilter},
};

/// Finds the step at which each pair of triangles with overlapping boxes was dropped.
///
/// The answer is computed from the current state. Call it after
/// [`DeformableSystems::Detect`](crate::DeformableSystems::Detect) and before positions or settings are written again,
/// which may happen from [`DeformableSystems::Respond`](crate::DeformableSystems::Respond) on. Then the
/// [`PairFate::Touching`] pairs are exactly the touching pairs of the [`ContactStore`](crate::ContactStore).
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::{detection::PairFates, kernel::pair_fate::PairFate, prelude::*};
/// # use bevy_ecs::{prelude::*, system::RunSystemOnce};
/// # use glam::Vec3;
/// # let mut app = App::new();
/// # app.add_plugins(DeformableCollisionPlugins::new(Update));
/// # let sheet = |app: &mut App, height: f32| {
/// #     let corners = [Vec3::new(0.0, height, 0.0), Vec3::new(0.0, height, 1.0), Vec3::new(1.0, height, 0.0)];
/// #     let surface = DeformableSurface::from_mesh(&corners, &[[0, 1, 2]]).expect("one triangle");
/// #     app.world_mut().spawn((surface, SurfaceThickness::World(0.05))).id()
/// # };
/// # let (sleeve, arm) = (sheet(&mut app, 0.0), sheet(&mut app, 0.08));
/// # app.update();
/// # let fate = app.world_mut().run_system_once(move |fates: PairFates| -> Option<PairFate> {
/// // Why does this triangle of the sleeve not touch that one of the arm?
/// fates.between((sleeve, TriangleId(0)), (arm, TriangleId(0)))
/// # });
/// # assert_eq!(fate.expect("the system runs"), Some(PairFate::Touching));
/// ```
#[derive(SystemParam)]
pub struct PairFates<'w, 's> {
    active: Res<'w, ActiveSurfaces>,
    candidates: Res<'w, CandidateTrianglePairs>,
    settings: Res<'w, CircumsphereSettings>,
    kept: Res<'w, KeptPairs>,
    states: Res<'w, SurfaceStates>,
    surfaces: SphereQuery<'w, 's>,
    game: Option<Res<'w, ContactFilter>>,
}

impl PairFates<'_, '_> {
    /// Replaces `fates` by those of [`CandidateTrianglePairs::pairs`]`[place]`. First comes one for each of its
    /// `triangles`, in their order. Then come the pairs that the broad phase dropped although their boxes overlap:
    /// [`PairFate::Planes`] for those dropped by slabs or normal cones or, if it reused a list of an earlier tick,
    /// [`PairFate::Remembered`] for those that the list skipped.
    ///
    /// Empty if the index is out of range or a surface no longer exists. Takes about as long as the stages of the pair
    /// took.
    pub fn of(&self, place: usize, fates: &mut Vec<([u32; 2], PairFate)>) {
        fates.clear();
        let Some(pair) = self.candidates.pairs.get(place) else { return };
        let Some(of_candidates) = self.of_triangles(pair, &pair.triangles) else { return };
        fates.extend(pair.triangles.iter().copied().zip(of_candidates));
        fates.extend(self.remembered(place, pair).into_iter().map(|triangles| (triangles, PairFate::Remembered)));
        fates.extend(self.dropped_by_slabs(place, pair).into_iter().map(|triangles| (triangles, PairFate::Planes)));
    }

    /// The fate of two triangles, each with its entity, in either order. For a solid that is tested by formula, the
    /// triangle is `TriangleId(0)`. `None` if the broad phase has not paired them (their boxes do not overlap, their
    /// layers do not meet, the surface has no self-collision, …) or has left them out, and where [`of`](Self::of) is empty.
    #[must_use]
    pub fn between(&self, a: (Entity, TriangleId), b: (Entity, TriangleId)) -> Option<PairFate> {
        self.candidates.pairs.iter().enumerate().find_map(|(place, pair)| {
            let entities = self.entities(pair)?;
            [(a, b), (b, a)].into_iter().filter(|(first, second)| entities == [first.0, second.0]).find_map(
                |(first, second)| {
                    let triangles = [first.1.0, second.1.0];
                    if pair.is_self() && self.are_neighbors(pair.first, first.1, second.1) {
                        Some(PairFate::Neighbors)
                    } else if pair.triangles.contains(&triangles) {
                        self.of_triangles(pair, &[triangles])?.first().copied()
                    } else if let Some(mut listed) = self.kept.reused(place) {
                        let is_whole = self.is_as_detected(pair, &[triangles]);
                        (is_whole && listed.any(|other| other == triangles) && self.may_touch(pair, triangles))
                            .then_some(PairFate::Remembered)
                    } else {
                        let parts = |traversal: Traversal<'_>| traversal.is_dropped_by_slabs(triangles);
                        self.traverse(pair, parts)?.then_some(PairFate::Planes)
                    }
                },
            )
        })
    }

    /// The pairs of triangles that a list of an earlier tick skipped, because of their remembered distance or a slab.
    pub(crate) fn remembered(&self, place: usize, pair: &SurfacePair) -> Vec<[u32; 2]> {
        let Some(listed) = self.kept.reused(place).filter(|_| self.is_as_detected(pair, &[])) else {
            return Vec::new();
        };
        let candidates: HashSet<[u32; 2]> = pair.triangles.iter().copied().collect();
        let may_touch = |triangles: &[u32; 2]| self.may_touch(pair, *triangles);
        listed.filter(|triangles| !candidates.contains(triangles) && may_touch(triangles)).collect()
    }

    /// The pairs of triangles that the broad phase dropped by slabs or normal cones. Empty if another broad phase than the
    /// tree's ran.
    pub(crate) fn dropped_by_slabs(&self, place: usize, pair: &SurfacePair) -> Vec<[u32; 2]> {
        if self.kept.reused(place).is_some() {
            return Vec::new();
        }
        let threads = self.settings.threads;
        let mut dropped =
            self.traverse(pair, |traversal| traversal.pairs_dropped_by_slabs(threads)).unwrap_or_default();
        // A system after the broad phase may have added some of these again.
        let candidates: HashSet<[u32; 2]> = pair.triangles.iter().copied().collect();
        dropped.retain(|triangles| !candidates.contains(triangles));
        dropped
    }

    /// Calls `ask` with the traversal of the trees that the broad phase used for a pair. `None` if it did not use them,
    /// or if they no longer are what was detected.
    fn traverse<T>(&self, pair: &SurfacePair, ask: impl FnOnce(Traversal<'_>) -> T) -> Option<T> {
        let OtherSide::Surface(second) = pair.second else { return None };
        if !self.is_as_detected(pair, &[]) {
            return None;
        }
        let moved = pair.moved_surface(&self.active).map(|surface| surface.entity);
        let states = self.states.all();
        let [first_region, second_region] = pair.needed_regions([pair.first, second].map(|place| states[place].tree()));
        let side = |place: usize, region: Option<Region>| {
            let surface = &self.active.surfaces[place];
            let state = &states[place];
            let needed =
                if moved == Some(surface.entity) { Needed::Boxes } else { pair.needs_of_triangles(&self.settings) };
            state.tree.is_current(&surface.topology, state.version(), needed, region).then_some(state)
        };
        let sides = [side(pair.first, first_region)?, side(second, second_region)?];
        let mut leaves = MovedLeaves::default();
        Some(ask(Traversal::new(&self.active, pair, &self.settings, sides, &mut leaves)?))
    }

    /// Whether the last step of the broad phase leaves two triangles in.
    fn may_touch(&self, pair: &SurfacePair, triangles: [u32; 2]) -> bool {
        let sides = pair.filter_sides(&self.active);
        let filter = PairFilter::between(&sides[0], &sides[1], pair.is_self(), self.game.as_deref());
        filter.is_none_or(|filter| filter.allows(triangles))
    }

    /// Whether two triangles of a surface are different and share a vertex.
    fn are_neighbors(&self, place: usize, a: TriangleId, b: TriangleId) -> bool {
        let topology = &self.active.surfaces[place].topology;
        let count = topology.triangles().len();
        a != b && a.index().max(b.index()) < count && topology.share_vertex(a, b)
    }

    fn entities(&self, pair: &SurfacePair) -> Option<[Entity; 2]> {
        let second = match pair.second {
            OtherSide::Surface(second) => self.active.surfaces.get(second)?.entity,
            OtherSide::Shape(place) => self.active.shapes.get(place)?.entity,
        };
        Some([self.active.surfaces.get(pair.first)?.entity, second])
    }

    /// The fates of some of a pair's candidates. `None` if the pair is no longer what was detected.
    pub(crate) fn of_triangles(&self, pair: &SurfacePair, triangles: &[[u32; 2]]) -> Option<Vec<PairFate>> {
        let settings = pair_settings(pair, &self.settings);
        let map = |work: &(dyn Fn(&[[u32; 2]], &mut Vec<PairFate>) + Sync)| {
            let mut fates = Vec::new();
            append_chunks(triangles, self.settings.threads, &Buffers::default(), &mut fates, work, Vec::append);
            fates
        };
        if !self.is_as_detected(pair, triangles) {
            return None;
        }
        match pair.second {
            OtherSide::Shape(place) => {
                let shape = &self.active.shapes[place].geometry;
                let side = side_on_shape(&self.active, pair, &self.states.all()[pair.first]);
                Some(map(&|chunk, fates| {
                    shape_fates(&side, shape, chunk, &settings, fates);
                }))
            }
            OtherSide::Surface(second) => match pair.method {
                ContactMethod::BoundingSphere => {
                    with_balls(&self.active, self.states.all(), &self.surfaces, pair, &SphereRows::default(), |a, b| {
                        map(&|chunk, fates| ball_fates(a, b, chunk, &settings, fates))
                    })
                }
                ContactMethod::Circumsphere if pair.is_smooth(&self.active) => {
                    with_osculating(&self.active, self.states.all(), &self.surfaces, pair, |a, b| {
                        map(&|chunk, fates| osculating_fates(a, b, chunk, &settings, fates))
                    })
                }
                ContactMethod::Circumsphere => {
                    with_caps(&self.active, self.states.all(), &self.surfaces, pair, &SphereRows::default(), |a, b| {
                        map(&|chunk, fates| cap_fates(a, b, chunk, &settings, fates))
                    })
                }
                ContactMethod::Closest | ContactMethod::Exact | ContactMethod::Polygon => {
                    let states = [pair.first, second].map(|place| &self.states.all()[place]);
                    let [a, b] = surface_sides(&self.active, pair, states)?;
                    let test = if pair.method == ContactMethod::Closest { closest_pairs } else { exact_pairs };
                    let bulge = f64::from(pair.bulge);
                    let examine =
                        |a: &SurfaceSide<'_>, b: &SurfaceSide<'_>, pairs: &[[u32; 2]], found: &mut FoundPairs| {
                            if bulge > 0.0 {
                                test(&a.evenly_thick(), &b.evenly_thick(), pairs, &settings.widened(bulge), found);
                                refine_pair([a, b], &settings, 1, found);
                            } else {
                                test(a, b, pairs, &settings, found);
                            }
                        };
                    Some(map(&|chunk, fates| exact_fates(&a, &b, chunk, &settings, examine, fates)))
                }
            },
        }
    }

    /// Whether everything that the triangles refer to still exists.
    fn is_as_detected(&self, pair: &SurfacePair, triangles: &[[u32; 2]]) -> bool {
        let side = |place: usize, side: usize| {
            let (Some(surface), Some(_)) = (self.active.surfaces.get(place), self.states.all().get(place)) else {
                return false;
            };
            let Ok((balls, spheres, cones, _)) = self.surfaces.get(surface.entity) else { return false };
            let count = surface.topology.triangles().len();
            let has_spheres = match pair.method {
                ContactMethod::BoundingSphere => balls.len() == count,
                ContactMethod::Circumsphere => [spheres.centers.len(), cones.axes.len()] == [count; 2],
                ContactMethod::Closest | ContactMethod::Exact | ContactMethod::Polygon => true,
            };
            has_spheres && triangles.iter().all(|triangles| (triangles[side] as usize) < count)
        };
        if !side(pair.first, 0) {
            return false;
        }
        match pair.second {
            OtherSide::Surface(second) => side(second, 1),
            OtherSide::Shape(place) => place < self.active.shapes.len(),
        }
    }
}
