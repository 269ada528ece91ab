//! The sphere through a triangle's vertices, offset below its plane, and the recipe that makes it cheap to refit.
//!
//! Flat regions get large spheres with shallow caps, sharp regions the small sphere about the circumcenter. A *recipe*
//! stores where a triangle's sphere is relative to its longest edge. In every tick the sphere follows the vertices by
//! its recipe, and only a triangle whose shape has changed gets a new one. Reads the results of `curvature`; read by
//! `cone` and by the sphere overlap stage. The circumcenter is the classical barycenter formula, see [`circumcenter`].
//! Offset and cone are the source paper's construction, with the height clamped at creases.

use std::sync::atomic::{AtomicUsize, Ordering};

use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::Vec3;

use super::{
    cone::SafetyCones,
    recipe::{PlacedLanes, Recipe, RecipeBlock, RecipeLanes, ShapeLanes},
};
use crate::kernel::simd::{
    lanes::{
        EdgeChoice, FrameLanes, LEAST_EXACT_SQUARE, RADIUS_SLACK, SetLanes, TriangleLanes, VectorLanes, WIDTH,
        ZERO_AREA, first_lanes, rows, store_first,
    },
    parallel::{LEAST_SHARE, PART, Parallel, Sequential},
};

/// How far the in-plane center of an obtuse triangle may be from the midpoint of its longest edge, in halves of that
/// edge. √3 still reaches the circumcenter of a triangle with a largest angle of 150°.
pub(in crate::kernel) const OBTUSE_REACH: f32 = 1.732_050_8;

/// A ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its center.
    pub center: Vec3,
    /// Its radius, at least 0.
    pub radius: f32,
}

impl From<Ball> for [f32; 4] {
    /// The center, then the radius.
    #[inline]
    fn from(Ball { center, radius }: Ball) -> Self {
        [center.x, center.y, center.z, radius]
    }
}

/// A triangle relative to its longest edge.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct LongestEdgeFrame {
    /// The midpoint of that edge.
    pub(in crate::kernel) midpoint: Vec3,
    half_length: f32,
    /// Unit normal. `None` if the triangle has no area.
    pub(in crate::kernel) normal: Option<Vec3>,
    /// Unit vector in the plane, perpendicular to the longest edge, toward the opposite corner.
    inward: Vec3,
    /// Cotangent of the angle opposite the longest edge, which is the largest angle.
    pub(in crate::kernel) cotangent: f32,
}

impl LongestEdgeFrame {
    /// Computes the frame relative to `origin`. `edge` is the longest edge, which joins corners `edge` and `edge + 1`.
    pub(in crate::kernel) fn new(corners: [Vec3; 3], origin: Vec3, edge: usize) -> Self {
        let (from, to, apex) = (corners[edge], corners[(edge + 1) % 3], corners[(edge + 2) % 3]);
        let along = finite(to - from);
        let length = length(along);
        let midpoint = finite(from - origin) + along * 0.5;
        let mut frame = Self { midpoint, half_length: 0.5 * length, normal: None, inward: Vec3::ZERO, cotangent: 0.0 };
        // The inverse of a subnormal length may be infinite.
        if length >= f32::MIN_POSITIVE {
            // Scaled by the longest edge first: the cross product is of order length², its square of order length⁴.
            let scale = length.recip();
            let (u, v) = ((from - apex) * scale, (to - apex) * scale);
            let cross = u.cross(v);
            let doubled_area = cross.length();
            // Infinite or NaN for a needle: the edge, once the longest, is now negligible beside the others.
            if doubled_area > ZERO_AREA && doubled_area.is_finite() {
                let normal = cross / doubled_area;
                frame.normal = Some(normal);
                frame.inward = normal.cross(along * scale).normalize_or_zero();
                frame.cotangent = u.dot(v) / doubled_area;
            }
        }
        frame
    }

    /// The point of the plane across from the midpoint of the longest edge, at a distance in halves of that edge.
    pub(in crate::kernel) fn point_across(&self, halves: f32) -> Vec3 {
        self.midpoint + self.inward * (halves * self.half_length).min(f32::MAX)
    }
}

/// Length of a vector of any size, at most the largest f32. Squares of lengths above 1e19 are infinite in f32, and
/// squares of lengths below 1e-19 are too coarse or 0. Those are computed in f64.
pub(in crate::kernel) fn length(vector: Vec3) -> f32 {
    let squared = vector.length_squared();
    if (LEAST_EXACT_SQUARE..=f32::MAX).contains(&squared) {
        squared.sqrt()
    } else {
        (vector.as_dvec3().length() as f32).min(f32::MAX)
    }
}

/// Clamps overflowed coordinates to the largest f32: infinities would soon become NaN.
fn finite(vector: Vec3) -> Vec3 {
    vector.clamp(Vec3::MIN, Vec3::MAX)
}

pub(in crate::kernel) fn edge_lengths(corners: [Vec3; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| length(corners[(k + 1) % 3] - corners[k]))
}

pub(in crate::kernel) fn longest(lengths: [f32; 3]) -> usize {
    // Ties go to the first edge, so that the choice depends only on the lengths.
    (0..3).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best })
}

pub(in crate::kernel) fn farthest_corner(corners: [Vec3; 3], center: Vec3) -> f32 {
    corners.iter().map(|&corner| length(corner - center)).fold(0.0, f32::max)
}

fn containing_radius(corners: [Vec3; 3], center: Vec3) -> f32 {
    (farthest_corner(corners, center) * RADIUS_SLACK).min(f32::MAX)
}

/// Circumcenter of a triangle, relative to its vertex with the largest angle, and the circumradius. `None` if the
/// triangle has no area. With the edges `u` and `v` from that vertex and `n = u × v`, the center is
/// `((v × n)|u|² + (n × u)|v|²) / (2|n|²)`, evaluated on edges scaled to unit length.
///
/// Returns `(vertex, offset, radius)`: the corner 0–2 that the center is relative to, the vector from there, and the
/// radius.
#[must_use]
pub fn circumcenter(corners: [Vec3; 3]) -> Option<(usize, Vec3, f32)> {
    let lengths = edge_lengths(corners);
    let edge = longest(lengths);
    let apex = (edge + 2) % 3;
    let length = lengths[edge];
    if length < f32::MIN_POSITIVE {
        return None;
    }
    let scale = length.recip();
    let u = finite(corners[edge] - corners[apex]) * scale;
    let v = finite(corners[(edge + 1) % 3] - corners[apex]) * scale;
    let n = u.cross(v);
    if n.length() <= ZERO_AREA {
        return None;
    }
    let offset = (v.cross(n) * u.length_squared() + n.cross(u) * v.length_squared()) / (2.0 * n.length_squared());
    Some((apex, offset * length, offset.length() * length))
}

/// The in-plane center of a triangle, and the distance of its farthest corner. For acute triangles, these are the
/// circumcenter and the circumradius. For obtuse triangles, the circumcenter is moved toward the midpoint of the
/// longest edge if it is farther than √3 halves of that edge from there, so that the radius stays bounded. Without
/// area, the center is that midpoint.
#[must_use]
pub fn in_plane_center(corners: [Vec3; 3]) -> Ball {
    let frame = LongestEdgeFrame::new(corners, Vec3::ZERO, longest(edge_lengths(corners)));
    let center = finite(frame.point_across(frame.cotangent.max(-OBTUSE_REACH)));
    Ball { center, radius: farthest_corner(corners, center) }
}

/// The smallest ball that contains a triangle: about the circumcenter, or about the midpoint of the longest edge if the
/// triangle is obtuse or has no area.
#[must_use]
pub fn enclosing_ball(corners: [Vec3; 3]) -> Ball {
    let frame = LongestEdgeFrame::new(corners, Vec3::ZERO, longest(edge_lengths(corners)));
    let center = finite(frame.point_across(frame.cotangent.max(0.0)));
    Ball { center, radius: containing_radius(corners, center) }
}

/// Writes [`enclosing_ball`] of every triangle into `balls`.
pub fn enclosing_balls(positions: &[Vec3], triangles: &[[u32; 3]], balls: &mut Vec<Ball>) {
    enclosing_balls_on(&Sequential, positions, triangles, balls);
}

/// Like [`enclosing_balls`], in tasks that `parallel` may distribute.
pub fn enclosing_balls_on(parallel: &impl Parallel, positions: &[Vec3], triangles: &[[u32; 3]], balls: &mut Vec<Ball>) {
    balls.resize(triangles.len(), Ball { center: Vec3::ZERO, radius: 0.0 });
    let parts = triangles.chunks(PART).zip(balls.chunks_mut(PART));
    parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |(triangles, balls)| {
        dispatch!(simd => write_enclosing_balls(simd, positions, triangles, balls));
    });
}

/// Enlarges enclosing balls so that each contains everything within a height of its triangle.
pub fn enlarge_balls(balls: &mut [Ball], heights: &[f32]) {
    for (ball, height) in balls.iter_mut().zip(heights) {
        ball.radius = (ball.radius + height) * (1.0 + f32::EPSILON);
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn write_enclosing_balls<S: Simd>(simd: S, positions: &[Vec3], triangles: &[[u32; 3]], balls: &mut [Ball]) {
    for (triangles, balls) in triangles.chunks(WIDTH).zip(balls.chunks_mut(WIDTH)) {
        let lanes = TriangleLanes::gather(simd, positions, triangles);
        let (lengths, exact_lengths) = lanes.edge_lengths();
        let frame =
            FrameLanes::new(&lanes, VectorLanes::splat(simd, Vec3::ZERO), EdgeChoice::longest(&lengths), &lengths);
        let center = frame.point_across(frame.cotangent.max(0.0));
        let (radius, exact_radius) = lanes.containing_radius(center);
        let spheres = rows([center.x, center.y, center.z, radius]);
        for (ball, sphere) in balls.iter_mut().zip(spheres) {
            *ball = Ball { center: Vec3::new(sphere[0], sphere[1], sphere[2]), radius: sphere[3] };
        }
        let exact = (exact_lengths & frame.exact & exact_radius).to_bitmask() as u32;
        for lane in SetLanes(!exact & first_lanes(triangles.len()) as u32) {
            balls[lane] = enclosing_ball(triangles[lane].map(|vertex| positions[vertex as usize]));
        }
    }
}

/// Cubic Hermite factor of the curvature: 1 on flat regions, 0 where `|curvature| · radius` reaches `threshold`
/// (dimensionless, useful from 0.5 to 2), and `1 − 3t² + 2t³` in between.
#[must_use]
pub fn curvature_factor(curvature: f32, radius: f32, threshold: f32) -> f32 {
    let t = (curvature.abs() * radius / threshold).clamp(0.0, 1.0);
    (1.0 - 3.0 * t * t + 2.0 * t * t * t).clamp(0.0, 1.0)
}

/// The parameters of a new recipe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecipeSettings {
    /// Height of a flat triangle's sphere center below its plane, in radii of the triangle. 0 or more.
    pub sphere_offset: f32,
    /// Curvature times radius at which the height reaches 0. Greater than 0.
    pub curvature_threshold: f32,
    /// Change of shape beyond which a recipe is refreshed: relative change of an edge length, or change of a dihedral
    /// angle in radians. 0 always refreshes.
    pub refit_threshold: f32,
}

/// The spheres and cones of eight triangles.
struct SphereLanes<S: Simd> {
    center: VectorLanes<S>,
    radius: f32x8<S>,
    height: f32x8<S>,
    axis: VectorLanes<S>,
    cosine: f32x8<S>,
    /// Where they are exact.
    exact: mask32x8<S>,
}

impl<S: Simd> SphereLanes<S> {
    /// [`SpherePart::follow`]
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(recipes: &RecipeLanes<S>, placed: &PlacedLanes<S>, corners: &TriangleLanes<S>) -> Self {
        let axis = placed.frame.normal;
        let height = (recipes.height_ratio * placed.farthest).min(f32::MAX);
        let center = corners.0[0].plus(placed.center - axis.scaled(height));
        let (radius, exact_radius) = corners.containing_radius(center);
        Self { center, radius, height, axis, cosine: (height / radius).min(1.0), exact: placed.exact & exact_radius }
    }
}

/// The offset spheres of a surface's triangles as a structure of arrays, and the recipes that they follow.
#[derive(Clone, Debug, Default)]
pub struct OffsetSpheres {
    /// Centers, below the triangles' planes by [`heights`](Self::heights).
    pub centers: Vec<Vec3>,
    /// Radii: the distance of the farthest corner from the center.
    pub radii: Vec<f32>,
    /// Heights of the in-plane centers above the sphere centers.
    pub heights: Vec<f32>,
    recipes: Vec<RecipeBlock>,
    /// The number of triangles with recipes.
    recipe_count: usize,
    /// The number of refits so far.
    refits: u32,
}

impl OffsetSpheres {
    /// Forgets every recipe. The next [`refit`](Self::refit) makes new ones.
    pub fn forget(&mut self) {
        self.recipe_count = 0;
    }

    /// Counts a [refit](Self::refit) that would have changed nothing: all recipes age by one.
    pub(crate) fn rest(&mut self) {
        self.refits = self.refits.wrapping_add(1);
    }

    /// How many [refits](Self::refit) ago each triangle's recipe was made, including those that would have changed
    /// nothing. 0 if the last one made it.
    pub fn recipe_ages(&self) -> impl ExactSizeIterator<Item = u32> {
        (0..self.recipe_count)
            .map(|triangle| self.refits.wrapping_sub(self.recipes[triangle / WIDTH].made_at(triangle % WIDTH)))
    }

    /// Refits the spheres to the current `positions`. Refreshes the recipes of triangles whose shape has changed by
    /// more than `settings.refit_threshold` since their last refresh, then writes every triangle's sphere and cone. `curvatures`
    /// and `dihedrals` have one entry per triangle (see [`curvature`](super::curvature)). Returns the number of
    /// refreshed recipes.
    ///
    /// Every sphere contains its triangle, however old its recipe. A fresh one passes through the triangle's vertices,
    /// or, if the largest angle is above 150°, through the two ends of the longest edge.
    pub fn refit(
        &mut self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        curvatures: &[f32],
        dihedrals: &[[f32; 3]],
        settings: RecipeSettings,
        cones: &mut SafetyCones,
    ) -> usize {
        self.refit_on(&Sequential, positions, triangles, curvatures, dihedrals, settings, cones)
    }

    /// Like [`refit`](Self::refit), in tasks that `parallel` may distribute.
    #[expect(clippy::too_many_arguments, reason = "the shape of a surface, who runs the tasks, and where the cones go")]
    pub fn refit_on(
        &mut self,
        parallel: &impl Parallel,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        curvatures: &[f32],
        dihedrals: &[[f32; 3]],
        settings: RecipeSettings,
        cones: &mut SafetyCones,
    ) -> usize {
        let count = triangles.len();
        let all_fresh = self.recipe_count != count;
        self.recipes.resize(count.div_ceil(WIDTH), RecipeBlock::EMPTY);
        self.recipe_count = count;
        self.centers.resize(count, Vec3::ZERO);
        self.radii.resize(count, 0.0);
        self.heights.resize(count, 0.0);
        cones.resize(count);
        self.refits = self.refits.wrapping_add(1);
        let refits = self.refits;
        let shapes = triangles.chunks(PART).zip(curvatures.chunks(PART)).zip(dihedrals.chunks(PART));
        let spheres = self.centers.chunks_mut(PART).zip(self.radii.chunks_mut(PART)).zip(self.heights.chunks_mut(PART));
        let cones = cones.axes.chunks_mut(PART).zip(cones.cosines.chunks_mut(PART));
        let parts = shapes.zip(spheres).zip(cones).zip(self.recipes.chunks_mut(PART / WIDTH));
        let refreshed = AtomicUsize::new(0);
        parallel.run_tasks(parts, count / LEAST_SHARE, |(((shapes, spheres), (axes, cosines)), recipes)| {
            let ((triangles, curvatures), dihedrals) = shapes;
            let ((centers, radii), heights) = spheres;
            let shapes = Shapes { positions, triangles, curvatures, dihedrals };
            let mut part = SpherePart { centers, radii, heights, axes, cosines, recipes, refits };
            let count = dispatch!(simd => refit_spheres(simd, &mut part, &shapes, all_fresh, settings));
            refreshed.fetch_add(count, Ordering::Relaxed);
        });
        refreshed.into_inner()
    }
}

/// The spheres, cones, and recipes of consecutive triangles, indexed from the first of them.
struct SpherePart<'a> {
    centers: &'a mut [Vec3],
    radii: &'a mut [f32],
    heights: &'a mut [f32],
    axes: &'a mut [Vec3],
    cosines: &'a mut [f32],
    recipes: &'a mut [RecipeBlock],
    refits: u32,
}

impl SpherePart<'_> {
    /// Refits one triangle by itself. Returns whether its recipe was refreshed.
    #[cold]
    fn refit_one(&mut self, shapes: &Shapes<'_>, triangle: usize, fresh: bool, settings: RecipeSettings) -> bool {
        let corners = shapes.triangles[triangle].map(|vertex| shapes.positions[vertex as usize]);
        // Relative to one corner, so that distance from the origin costs no precision.
        let local = corners.map(|corner| finite(corner - corners[0]));
        let (curvature, dihedrals) = (shapes.curvatures[triangle], shapes.dihedrals[triangle]);
        let (block, lane) = (&mut self.recipes[triangle / WIDTH], triangle % WIDTH);
        let mut recipe = block.get(lane);
        let stale = fresh
            || settings.refit_threshold <= 0.0
            || recipe.shape_change(edge_lengths(corners), dihedrals) > settings.refit_threshold;
        if stale {
            recipe = Recipe::new(corners, local, curvature, dihedrals, settings, self.refits);
            block.set(lane, &recipe);
        }
        self.follow(&recipe, triangle, corners, local);
        stale
    }

    /// Takes the corners, and the corners relative to the first one.
    fn follow(&mut self, recipe: &Recipe, triangle: usize, corners: [Vec3; 3], local: [Vec3; 3]) {
        let frame = LongestEdgeFrame::new(corners, corners[0], recipe.longest_edge as usize);
        let (in_plane, axis, height) = if let Some(normal) = frame.normal {
            let in_plane = frame.point_across(recipe.inward);
            (in_plane, normal, (recipe.height_ratio * farthest_corner(local, in_plane)).min(f32::MAX))
        } else {
            let frame = LongestEdgeFrame::new(corners, corners[0], longest(edge_lengths(corners)));
            (frame.midpoint, self.axes[triangle], 0.0)
        };
        let center = finite(corners[0] + (in_plane - axis * height));
        let radius = containing_radius(corners, center);
        self.centers[triangle] = center;
        self.radii[triangle] = radius;
        self.heights[triangle] = height;
        self.axes[triangle] = axis;
        self.cosines[triangle] = match frame.normal {
            // Far from the origin, rounding moves the center by more than a small triangle's height.
            Some(_) if radius > 0.0 => (height / radius).min(1.0),
            _ => SafetyCones::EVERYWHERE,
        };
    }

    /// Writes the spheres and cones of the triangles from `first` on.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn write<S: Simd>(&mut self, first: usize, lanes: &SphereLanes<S>) {
        let end = (first + WIDTH).min(self.radii.len());
        lanes.center.write(&mut self.centers[first..end]);
        lanes.axis.write(&mut self.axes[first..end]);
        store_first(lanes.radius, &mut self.radii[first..end]);
        store_first(lanes.height, &mut self.heights[first..end]);
        store_first(lanes.cosine, &mut self.cosines[first..end]);
    }
}

/// What spheres are computed from.
struct Shapes<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    curvatures: &'a [f32],
    dihedrals: &'a [[f32; 3]],
}

#[cfg_attr(not(unoptimized), inline(always))]
fn refit_spheres<S: Simd>(
    simd: S,
    spheres: &mut SpherePart<'_>,
    shapes: &Shapes<'_>,
    all_fresh: bool,
    settings: RecipeSettings,
) -> usize {
    let always = all_fresh || settings.refit_threshold <= 0.0;
    let mut refreshed = 0;
    for (block, triangles) in shapes.triangles.chunks(WIDTH).enumerate() {
        let range = block * WIDTH..block * WIDTH + triangles.len();
        let corners = TriangleLanes::gather(simd, shapes.positions, triangles);
        let (lengths, mut exact) = corners.edge_lengths();
        let (curvatures, dihedrals) = (&shapes.curvatures[range.clone()], &shapes.dihedrals[range.clone()]);
        let shape = ShapeLanes::gather(simd, corners, lengths, curvatures, dihedrals);
        let mut recipes = RecipeLanes::load(simd, &spheres.recipes[block]);
        let stale = if always {
            mask32x8::splat(simd, true)
        } else {
            recipes.shape_change(&shape).simd_gt(settings.refit_threshold)
        };
        let placed = if stale.any_true() {
            let made = recipes.refresh(stale, &shape, &settings);
            exact &= made.exact | !stale;
            if stale.all_true() { made } else { recipes.place(&shape) }
        } else {
            recipes.place(&shape)
        };
        let lanes = SphereLanes::new(&recipes, &placed, &shape.corners);
        let inexact = (!(exact & lanes.exact)).to_bitmask() & first_lanes(range.len());
        // One lane that is not exact sends its whole block here. Such lanes are rare, and the results are the same.
        if inexact != 0 {
            for triangle in range {
                refreshed += usize::from(spheres.refit_one(shapes, triangle, all_fresh, settings));
            }
        } else {
            let stale = stale.to_bitmask() & first_lanes(range.len());
            if stale != 0 {
                recipes.store(&mut spheres.recipes[block], stale, spheres.refits);
            }
            spheres.write(range.start, &lanes);
            refreshed += stale.count_ones() as usize;
        }
    }
    refreshed
}
