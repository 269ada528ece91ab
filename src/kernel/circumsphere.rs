//! The sphere through a triangle's vertices, offset below its plane, and the recipe that keeps it cheap to refresh.
//!
//! Flat regions get large spheres with shallow caps, sharp regions the small sphere about the circumcenter. A *recipe*
//! remembers where a triangle's sphere sits relative to its longest edge; every tick follows the vertices by the
//! recipe, and only a triangle whose shape has changed gets a new one. Fed by `curvature`, read by `cone` and by the
//! sphere overlap stage. Circumcenter: the classical barycenter formula, see [`circumcenter`]; offset and cone: the
//! source paper's construction with the height clamped at creases.

use glam::Vec3;

use super::cone::SafetyCones;

/// How far an obtuse triangle's in-plane center may leave the midpoint of its longest edge, in halves of that edge.
/// At √3 the circumcenter of a triangle with a largest angle of 150° is still reached.
const OBTUSE_REACH: f32 = 1.732_050_8;

/// A triangle whose normal is shorter than this, relative to the square of its longest edge, has no area.
const ZERO_AREA: f32 = 1.0e-6;

/// Radii are lengthened by this factor, so that rounding never leaves a vertex outside its ball.
const RADIUS_SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Squares below this have lost precision to the end of f32, 2^23 times its least normal number.
pub(super) const LEAST_EXACT_SQUARE: f32 = f32::MIN_POSITIVE / f32::EPSILON;

/// A ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its center.
    pub center: Vec3,
    /// Its radius, at least 0.
    pub radius: f32,
}

/// A triangle seen from its longest edge, with everything relative to that edge's midpoint.
#[derive(Clone, Copy, Debug)]
struct LongestEdgeFrame {
    midpoint: Vec3,
    half_length: f32,
    /// Unit normal; `None` where the triangle has no area.
    normal: Option<Vec3>,
    /// Unit vector in the plane, across the longest edge, towards the opposite corner.
    inward: Vec3,
    /// Cotangent of the angle opposite the longest edge, which is the largest angle.
    cotangent: f32,
}

impl LongestEdgeFrame {
    /// `edge` names the longest edge, which joins the corners `edge` and `edge + 1`.
    fn new(corners: [Vec3; 3], edge: usize) -> Self {
        let (from, to, apex) = (corners[edge], corners[(edge + 1) % 3], corners[(edge + 2) % 3]);
        let along = finite(to - from);
        let length = length(along);
        let midpoint = from + along * 0.5;
        let mut frame = Self { midpoint, half_length: 0.5 * length, normal: None, inward: Vec3::ZERO, cotangent: 0.0 };
        // The inverse of a subnormal length may be infinite.
        if length >= f32::MIN_POSITIVE {
            // Scaled by the longest edge first: the cross product is of order length², its square of order length⁴.
            let scale = length.recip();
            let (u, v) = ((from - apex) * scale, (to - apex) * scale);
            let cross = u.cross(v);
            let doubled_area = cross.length();
            // Infinite or no number where the edge, the longest once, is now lost beside the others: a needle.
            if doubled_area > ZERO_AREA && doubled_area.is_finite() {
                let normal = cross / doubled_area;
                frame.normal = Some(normal);
                frame.inward = normal.cross(along * scale).normalize_or_zero();
                frame.cotangent = u.dot(v) / doubled_area;
            }
        }
        frame
    }

    /// The point of the plane that is across the middle of the longest edge by a multiple of half of that edge.
    fn point_across(&self, halves: f32) -> Vec3 {
        self.midpoint + self.inward * (halves * self.half_length).min(f32::MAX)
    }
}

/// Length of a vector of any length, at most the largest f32: squares of those above 1e19 are infinite in f32, of those
/// below 1e-19 too coarse or 0, and then f64 holds them.
pub(super) fn length(vector: Vec3) -> f32 {
    let squared = vector.length_squared();
    if (LEAST_EXACT_SQUARE..=f32::MAX).contains(&squared) {
        squared.sqrt()
    } else {
        (vector.as_dvec3().length() as f32).min(f32::MAX)
    }
}

/// A vector whose coordinates have overflown, brought back to the largest f32: infinities would soon be no numbers.
fn finite(vector: Vec3) -> Vec3 {
    vector.clamp(Vec3::MIN, Vec3::MAX)
}

fn edge_lengths(corners: [Vec3; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| length(corners[(k + 1) % 3] - corners[k]))
}

fn longest(lengths: [f32; 3]) -> usize {
    // Ties go to the first, so that the choice depends on nothing but the lengths.
    (0..3).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best })
}

fn farthest_corner(corners: [Vec3; 3], center: Vec3) -> f32 {
    corners.iter().map(|&corner| length(corner - center)).fold(0.0, f32::max)
}

fn containing_radius(corners: [Vec3; 3], center: Vec3) -> f32 {
    (farthest_corner(corners, center) * RADIUS_SLACK).min(f32::MAX)
}

/// Circumcenter of a triangle, relative to its vertex with the largest angle, and the circumradius; `None` where the
/// triangle has no area. With `u`, `v` the edges from that vertex and `n = u × v`, the center is
/// `((v × n)|u|² + (n × u)|v|²) / (2|n|²)`, evaluated on edges scaled to unit length.
///
/// Returns `(vertex, offset, radius)`: the corner 0–2 it is relative to, the vector from there, the radius.
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

/// The in-plane center of a triangle and the distance of its farthest corner. Acute triangles: the circumcenter and
/// the circumradius. Obtuse ones: the circumcenter, brought back towards the midpoint of the longest edge where it is
/// farther than √3 halves of that edge, so that the radius stays bounded. Without area: that midpoint.
#[must_use]
pub fn in_plane_center(corners: [Vec3; 3]) -> Ball {
    let frame = LongestEdgeFrame::new(corners, longest(edge_lengths(corners)));
    let center = finite(frame.point_across(frame.cotangent.max(-OBTUSE_REACH)));
    Ball { center, radius: farthest_corner(corners, center) }
}

/// The smallest ball that contains a triangle: about the circumcenter, or about the midpoint of the longest edge where
/// the triangle is obtuse or has no area.
#[must_use]
pub fn enclosing_ball(corners: [Vec3; 3]) -> Ball {
    let frame = LongestEdgeFrame::new(corners, longest(edge_lengths(corners)));
    let center = finite(frame.point_across(frame.cotangent.max(0.0)));
    Ball { center, radius: containing_radius(corners, center) }
}

/// Writes [`enclosing_ball`] of every triangle into `balls`.
pub fn enclosing_balls(positions: &[Vec3], triangles: &[[u32; 3]], balls: &mut Vec<Ball>) {
    balls.clear();
    balls.extend(triangles.iter().map(|&corners| enclosing_ball(corners.map(|vertex| positions[vertex as usize]))));
}

/// Cubic Hermite factor of the curvature: 1 on flat ground, 0 where `|curvature| · radius` reaches `threshold`
/// (dimensionless, useful from 0.5 to 2), and in between `1 − 3t² + 2t³`.
#[must_use]
pub fn curvature_factor(curvature: f32, radius: f32, threshold: f32) -> f32 {
    let t = (curvature.abs() * radius / threshold).clamp(0.0, 1.0);
    (1.0 - 3.0 * t * t + 2.0 * t * t * t).clamp(0.0, 1.0)
}

/// What shapes a fresh recipe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecipeSettings {
    /// Height of the sphere's center below a flat triangle, in radii of the triangle. 0 or more.
    pub phi: f32,
    /// Curvature times radius at which the height has come down to 0. More than 0.
    pub curvature_threshold: f32,
    /// Shape change beyond which a recipe is refreshed: relative change of an edge length, or of a dihedral angle in
    /// radians. 0 refreshes always.
    pub delta: f32,
}

/// How one triangle's sphere follows its vertices, and the shape it was made for.
///
/// The in-plane center is remembered as a multiple of half the longest edge, across that edge. Barycentric coordinates
/// would do the same for the shape they were made for, but run away when a thin triangle changes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Recipe {
    longest_edge: u8,
    inward: f32,
    height_ratio: f32,
    lengths: [f32; 3],
    dihedrals: [f32; 3],
    /// The [count of refits](OffsetSpheres::refits) at which it was made.
    made_at: u32,
}

impl Recipe {
    fn new(corners: [Vec3; 3], curvature: f32, dihedrals: [f32; 3], settings: RecipeSettings, made_at: u32) -> Self {
        let lengths = edge_lengths(corners);
        let edge = longest(lengths);
        let frame = LongestEdgeFrame::new(corners, edge);
        let inward = frame.cotangent.max(-OBTUSE_REACH);
        let mut recipe = Self { longest_edge: edge as u8, inward, height_ratio: 0.0, lengths, dihedrals, made_at };
        let Some(normal) = frame.normal else { return recipe };
        let center = frame.point_across(inward);
        let radius = farthest_corner(corners, center);
        let factor = curvature_factor(curvature, radius, settings.curvature_threshold);
        let mut height = (settings.phi * radius * factor).min(f32::MAX);
        for k in 0..3 {
            if dihedrals[k] > 0.0 {
                let edge = corners[(k + 1) % 3] - corners[k];
                let along = if lengths[k] > 0.0 { edge / lengths[k] } else { Vec3::ZERO };
                let clearance = normal.dot(along.cross(center - corners[k])).max(0.0);
                height = height.min(clearance / bevy_math::ops::tan(0.5 * dihedrals[k]).abs().max(f32::MIN_POSITIVE));
            }
        }
        if radius > 0.0 {
            recipe.height_ratio = height / radius;
        }
        recipe
    }

    fn shape_change(&self, lengths: [f32; 3], dihedrals: [f32; 3]) -> f32 {
        (0..3).fold(0.0, |change: f32, k| {
            // A length that was 0 has no relative change: any other length is a new shape.
            let stretch = if self.lengths[k] > 0.0 {
                (lengths[k] / self.lengths[k] - 1.0).abs()
            } else if lengths[k] > 0.0 {
                f32::INFINITY
            } else {
                0.0
            };
            change.max(stretch).max((dihedrals[k] - self.dihedrals[k]).abs())
        })
    }
}

/// The offset spheres of a surface's triangles, structure of arrays, and the recipes they follow.
#[derive(Clone, Debug, Default)]
pub struct OffsetSpheres {
    /// Centers, below the triangles' planes by [`heights`](Self::heights).
    pub centers: Vec<Vec3>,
    /// Radii: the farthest corner's distance from the center.
    pub radii: Vec<f32>,
    /// Heights of the in-plane centers above the sphere centers.
    pub heights: Vec<f32>,
    recipes: Vec<Recipe>,
    /// How many times the spheres have been refitted.
    refits: u32,
}

impl OffsetSpheres {
    /// Forgets every recipe: the next [`refit`](Self::refit) makes all of them anew.
    pub fn forget(&mut self) {
        self.recipes.clear();
    }

    /// How many [refits](Self::refit) ago each triangle's recipe was made: 0 where the last one made it.
    pub fn recipe_ages(&self) -> impl ExactSizeIterator<Item = u32> {
        self.recipes.iter().map(|recipe| self.refits.wrapping_sub(recipe.made_at))
    }

    /// Follows the current `positions`: refreshes the recipes of triangles whose shape has changed by more than
    /// `settings.delta` since their last refresh, then writes every triangle's sphere and cone. `curvatures` and
    /// `dihedrals` hold one entry a triangle (see [`curvature`](super::curvature)). Returns how many recipes were
    /// refreshed.
    ///
    /// Every sphere contains its triangle, however stale its recipe. A fresh one passes through the triangle's
    /// vertices, unless the triangle's largest angle is above 150°: then through the two ends of the longest edge.
    pub fn refit(
        &mut self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        curvatures: &[f32],
        dihedrals: &[[f32; 3]],
        settings: RecipeSettings,
        cones: &mut SafetyCones,
    ) -> usize {
        let count = triangles.len();
        let all_fresh = self.recipes.len() != count;
        if all_fresh {
            self.recipes.clear();
            self.recipes.reserve(count);
        }
        self.centers.resize(count, Vec3::ZERO);
        self.radii.resize(count, 0.0);
        self.heights.resize(count, 0.0);
        cones.resize(count);
        self.refits = self.refits.wrapping_add(1);
        let refits = self.refits;
        let mut refreshed = 0;
        for (triangle, vertices) in triangles.iter().enumerate() {
            let corners = vertices.map(|vertex| positions[vertex as usize]);
            let fresh = || Recipe::new(corners, curvatures[triangle], dihedrals[triangle], settings, refits);
            if all_fresh {
                self.recipes.push(fresh());
                refreshed += 1;
            } else {
                let change = self.recipes[triangle].shape_change(edge_lengths(corners), dihedrals[triangle]);
                if change > settings.delta || settings.delta <= 0.0 {
                    self.recipes[triangle] = fresh();
                    refreshed += 1;
                }
            }
            self.follow(triangle, corners, cones);
        }
        refreshed
    }

    fn follow(&mut self, triangle: usize, corners: [Vec3; 3], cones: &mut SafetyCones) {
        let recipe = &self.recipes[triangle];
        // Relative to one corner, so that distance from the origin costs no precision.
        let origin = corners[0];
        let local = corners.map(|corner| finite(corner - origin));
        let frame = LongestEdgeFrame::new(local, recipe.longest_edge as usize);
        let (in_plane, axis, height) = if let Some(normal) = frame.normal {
            let in_plane = frame.point_across(recipe.inward);
            (in_plane, normal, (recipe.height_ratio * farthest_corner(local, in_plane)).min(f32::MAX))
        } else {
            let frame = LongestEdgeFrame::new(local, longest(edge_lengths(local)));
            (frame.midpoint, cones.axes[triangle], 0.0)
        };
        let center = finite(origin + (in_plane - axis * height));
        let radius = containing_radius(corners, center);
        self.centers[triangle] = center;
        self.radii[triangle] = radius;
        self.heights[triangle] = height;
        cones.axes[triangle] = axis;
        cones.cosines[triangle] = match frame.normal {
            // Far from the origin the center is moved by rounding, by more than a small triangle's height.
            Some(_) if radius > 0.0 => (height / radius).min(1.0),
            _ => SafetyCones::EVERYWHERE,
        };
    }
}
