//! Collects what the kernel needs about a pair of surfaces: both sides, settings, and rows. Used by all stages after
//! the broad phase.

use bevy_ecs::{change_detection::Tick, prelude::*};
use glam::Vec3;

use crate::{
    detection::{
        pairs::{OtherSide, SurfacePair},
        state::SurfaceState,
    },
    kernel::{
        pair::{MovedSide, PairSettings, SurfaceSide},
        pose::Pose,
        simd::parallel::Parallel,
        spheres::{
            osculating_contacts::OsculatingSide,
            pairs::{BallSide, CapSide},
            rows::{BallRows, CapRows},
        },
    },
    settings::CircumsphereSettings,
    surface::{
        ActiveSurface, ActiveSurfaces, Circumspheres, ContactMethod, EnclosingBalls, SurfaceShape, TriangleCones,
        TriangleCurvature,
    },
};

/// The spheres of a surface.
type SphereData = (
    Ref<'static, EnclosingBalls>,
    Ref<'static, Circumspheres>,
    Ref<'static, TriangleCones>,
    &'static TriangleCurvature,
);

/// The spheres of every surface.
pub(crate) type SphereQuery<'w, 's> = Query<'w, 's, SphereData>;

/// The distances of a pair, for the kernel.
pub(crate) fn pair_settings(pair: &SurfacePair, settings: &CircumsphereSettings) -> PairSettings {
    PairSettings {
        contact_distance: f64::from(pair.contact_distance),
        reported_distance: f64::from(pair.reported_distance),
        range: f64::from(pair.range),
        bulge: 0.0,
        scale: pair.frame_pose.scale(),
        cull: match pair.method {
            ContactMethod::Polygon => false,
            ContactMethod::Circumsphere => settings.plane_cull,
            ContactMethod::BoundingSphere | ContactMethod::Closest | ContactMethod::Exact => true,
        },
        same_surface: pair.is_self(),
        any_left_out: pair.any_left_out,
    }
}

/// Calls `test` with the osculating spheres of both sides of a pair with a smooth surface.
pub(crate) fn with_osculating<T>(
    active: &ActiveSurfaces,
    states: &[SurfaceState],
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    test: impl FnOnce(&OsculatingSide<'_>, &OsculatingSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let places = [pair.first, second];
    let curvatures = |place: usize| -> Option<&[f32]> {
        let surface = &active.surfaces[place];
        if surface.shape == SurfaceShape::Flat {
            return Some(&[]);
        }
        let (.., curvature) = surfaces.get(surface.entity).ok()?;
        (curvature.curvatures.len() == surface.topology.triangles().len()).then_some(&*curvature.curvatures)
    };
    let sides = surface_sides(active, pair, places.map(|place| &states[place]))?;
    let [a, b] =
        [0, 1].map(|side| Some(OsculatingSide { surface: sides[side], curvatures: curvatures(places[side])? }));
    Some(test(&a?, &b?))
}

/// Both surfaces of a pair in its frame. `None` if the second side is a shape.
pub(crate) fn surface_sides<'a>(
    active: &'a ActiveSurfaces,
    pair: &'a SurfacePair,
    states: [&'a SurfaceState; 2],
) -> Option<[SurfaceSide<'a>; 2]> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let [first_positions, second_positions] = states.map(SurfaceState::positions);
    let [positions_a, positions_b] = pair.positions(first_positions, second_positions);
    let [pose_a, pose_b] = pair.poses();
    let [first, second_state] = states;
    Some([
        surface_side(&active.surfaces[pair.first], pair, first, positions_a, pose_a),
        surface_side(&active.surfaces[second], pair, second_state, positions_b, pose_b),
    ])
}

/// The surface of a pair with a rigid shape, in the shape's frame. Its positions are not transformed.
pub(crate) fn side_on_shape<'a>(
    active: &'a ActiveSurfaces,
    pair: &'a SurfacePair,
    state: &'a SurfaceState,
) -> SurfaceSide<'a> {
    surface_side(&active.surfaces[pair.first], pair, state, state.positions(), &pair.relative_pose)
}

fn surface_side<'a>(
    surface: &'a ActiveSurface,
    pair: &SurfacePair,
    state: &'a SurfaceState,
    positions: &'a [Vec3],
    pose: &'a Pose,
) -> SurfaceSide<'a> {
    let (own_positions, rounding) = (state.positions(), pair.moved_rounding);
    SurfaceSide {
        topology: &surface.topology,
        positions,
        moved: moving(pose).map(|pose| MovedSide { own_positions, pose, rounding }),
        one_sided: is_one_sided(surface, pair),
        mirrored: pose.is_mirrored(),
        rows: None,
        curved: state.bounds.curved(),
        thickness: surface.varying_thickness(),
    }
}

/// Whether a surface has an inside in a pair. Not in a self-collision, where behind a face may be the other side of a
/// thin wall.
pub(crate) fn is_one_sided(surface: &ActiveSurface, pair: &SurfacePair) -> bool {
    surface.one_sided && !pair.is_self()
}

/// The pose of a side that has to be transformed.
fn moving(pose: &Pose) -> Option<&Pose> {
    (*pose != Pose::IDENTITY).then_some(pose)
}

/// With `BoundingSphere`, the rows of all triangles are made if there is at least one pair per this many triangles.
/// Nearly all pairs of balls are in contact. With one pair per two triangles, rows halve the time of the overlap stage.
/// With one per four, it takes as long as without.
const TRIANGLES_OF_BALL_PAIR: usize = 3;

/// Like [`TRIANGLES_OF_BALL_PAIR`], with `Circumsphere`, where fewer pairs are in contact. With one pair per two
/// triangles, rows halve the time of the cone stage if most pairs meet. If hardly any pair meets, overlap takes twice
/// as long for little gain.
const TRIANGLES_OF_CAP_PAIR: usize = 2;

/// Like [`TRIANGLES_OF_BALL_PAIR`], for rows that are made only once, because the surface does not change. With fewer
/// pairs, they take more memory than they save time.
const TRIANGLES_OF_RESTING_PAIR: usize = 64;

/// For each method, the rows of active surfaces whose triangles are in many candidate pairs, or whose spheres do not
/// change. Other surfaces have none.
#[derive(Resource, Debug, Default)]
pub(crate) struct SphereRows {
    caps: Vec<MadeRows<CapRows>>,
    balls: Vec<MadeRows<BallRows>>,
    /// For each surface, the number of pairs that its triangles are in, by balls and by caps.
    counts: Vec<[usize; 2]>,
}

/// Rows, and what they were made from. None if they were not worth it.
#[derive(Debug, Default)]
struct MadeRows<R> {
    rows: R,
    source: Option<RowSource>,
}

/// The surface that rows belong to, the version of its positions, and when its spheres changed last. The source of the
/// spheres does not suffice: after a teleport, new spheres have the source of the old ones.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RowSource {
    surface: Entity,
    version: u64,
    changed: [Tick; 2],
}

impl<R> MadeRows<R> {
    fn get(&self) -> Option<&R> {
        self.source.is_some().then_some(&self.rows)
    }

    /// Makes the rows of `source` if that `is_worth_it`, unless they exist already.
    fn update(&mut self, source: RowSource, is_worth_it: bool, make: impl FnOnce(&mut R)) {
        if self.source == Some(source) {
            return;
        }
        self.source = is_worth_it.then_some(source);
        if is_worth_it {
            make(&mut self.rows);
        }
    }
}

impl SphereRows {
    /// Makes the rows of this tick for some pairs.
    pub(super) fn update<'a>(
        &mut self,
        active: &ActiveSurfaces,
        states: &[SurfaceState],
        surfaces: &SphereQuery,
        pairs: impl Iterator<Item = &'a SurfacePair>,
        parallel: &impl Parallel,
    ) {
        let Self { caps, balls, counts } = self;
        count_pairs(active, pairs, counts);
        caps.resize_with(counts.len(), MadeRows::default);
        balls.resize_with(counts.len(), MadeRows::default);
        let all_rows = balls.iter_mut().zip(caps);
        for (((active, state), &[by_balls, by_caps]), (ball_rows, cap_rows)) in
            active.surfaces.iter().zip(states).zip(&*counts).zip(all_rows)
        {
            let Ok((balls, spheres, cones, _)) = surfaces.get(active.entity) else { continue };
            let (topology, positions) = (&*active.topology, state.positions());
            let surface = SurfaceSide::flat(topology, positions);
            let source = |changed| RowSource { surface: active.entity, version: state.version(), changed };
            let is_worth_it = |pairs: usize, of_pair: usize, rests: bool| {
                let of_pair = if rests { TRIANGLES_OF_RESTING_PAIR } else { of_pair };
                pairs > 0 && of_pair * pairs >= topology.triangles().len()
            };
            let rests = !spheres.is_changed() && !cones.is_changed();
            let cap_source = source([spheres.last_changed(), cones.last_changed()]);
            cap_rows.update(cap_source, is_worth_it(by_caps, TRIANGLES_OF_CAP_PAIR, rests), |rows| {
                let side = CapSide { surface, spheres: &spheres, cones: &cones, pose: None, rows: None };
                side.rows(parallel, rows);
            });
            ball_rows.update(
                source([balls.last_changed(); 2]),
                is_worth_it(by_balls, TRIANGLES_OF_BALL_PAIR, !balls.is_changed()),
                |rows| {
                    BallSide { surface, balls: &balls, pose: None, rows: None }.rows(parallel, rows);
                },
            );
        }
    }

    /// Forgets all rows.
    pub(super) fn clear(&mut self) {
        self.caps.clear();
        self.balls.clear();
    }
}

fn count_pairs<'a>(
    active: &ActiveSurfaces,
    pairs: impl Iterator<Item = &'a SurfacePair>,
    counts: &mut Vec<[usize; 2]>,
) {
    counts.clear();
    counts.resize(active.surfaces.len(), [0; 2]);
    for pair in pairs {
        let OtherSide::Surface(second) = pair.second else { continue };
        let method = match pair.method {
            ContactMethod::BoundingSphere => 0,
            ContactMethod::Circumsphere if !pair.is_smooth(active) => 1,
            _ => continue,
        };
        let places = if pair.is_self() { &[pair.first][..] } else { &[pair.first, second] };
        for &place in places {
            counts[place][method] += pair.triangles.len();
        }
    }
}

/// The rows of a surface.
fn rows_of<R>(rows: &[MadeRows<R>], place: usize) -> Option<&R> {
    rows.get(place).and_then(MadeRows::get)
}

/// Calls `test` with the enclosing balls of both sides of a pair.
pub(crate) fn with_balls<T>(
    active: &ActiveSurfaces,
    states: &[SurfaceState],
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    rows: &SphereRows,
    test: impl FnOnce(&BallSide<'_>, &BallSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (balls_a, ..) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (balls_b, ..) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, [&states[pair.first], &states[second]])?;
    let [pose_a, pose_b] = pair.poses();
    let side = |place: usize, surface, balls, pose| {
        let rows = rows_of(&rows.balls, place);
        BallSide { surface, balls, pose: moving(pose), rows }
    };
    let (a, b) = (side(pair.first, surface_a, &balls_a, pose_a), side(second, surface_b, &balls_b, pose_b));
    Some(test(&a, &b))
}

/// Calls `test` with the offset spheres and cones of both sides of a pair.
pub(crate) fn with_caps<T>(
    active: &ActiveSurfaces,
    states: &[SurfaceState],
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    rows: &SphereRows,
    test: impl FnOnce(&CapSide<'_>, &CapSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (_, spheres_a, cones_a, _) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (_, spheres_b, cones_b, _) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, [&states[pair.first], &states[second]])?;
    let [pose_a, pose_b] = pair.poses();
    let side = |place: usize, surface, spheres, cones, pose| {
        let rows = rows_of(&rows.caps, place);
        CapSide { surface, spheres, cones, pose: moving(pose), rows }
    };
    let a = side(pair.first, surface_a, &spheres_a, &cones_a, pose_a);
    let b = side(second, surface_b, &spheres_b, &cones_b, pose_b);
    Some(test(&a, &b))
}
