//! What the stages know of the triangles of each surface: spheres, cones, curvature, recipe ages, and trees.
//!
//! Everything is in the surface's own frame, as the stages store it.

use glam::Vec3;

use super::{
    LevelOfDetail, colors,
    tick::{Detected, Touches},
};
#[cfg(feature = "rerun")]
use crate::kernel::mesh::bounds::Aabb;
use crate::{
    detection::SurfaceState,
    kernel::{
        bvh::tree::BoxTree,
        spheres::{
            circumsphere::{Ball, OffsetSpheres},
            cone::{Cap, SafetyCones},
            curvature::Curvatures,
        },
    },
    surface::{ActiveSurface, ContactMethod},
};

/// Number of corners of the circle that a cone cuts out of its sphere.
pub(super) const RIM_CORNERS: usize = 16;

/// A surface with the results of the stages in this tick.
pub(super) struct Body<'a> {
    place: usize,
    pub(super) surface: &'a ActiveSurface,
    positions: &'a [Vec3],
    /// Empty if no pair was tested with balls.
    balls: &'a [Ball],
    /// `None` if no pair was tested with offset spheres.
    pub(super) caps: Option<Caps<'a>>,
    /// `None` if the tree is not up to date in this tick.
    pub(super) tree: Option<&'a BoxTree>,
    /// The boxes of the regions that its traversal against itself leaves out.
    #[cfg(feature = "rerun")]
    pub(super) flat_regions: Vec<Aabb>,
}

#[derive(Clone, Copy)]
pub(super) struct Caps<'a> {
    pub(super) curvature: &'a Curvatures,
    spheres: &'a OffsetSpheres,
    cones: &'a SafetyCones,
}

impl<'a> Body<'a> {
    /// All active surfaces.
    pub(super) fn all(detected: &'a Detected) -> Vec<Self> {
        let by_balls = detected.used_by(ContactMethod::BoundingSphere);
        let by_caps = detected.used_by(ContactMethod::Circumsphere);
        let mut bodies = Vec::new();
        for (place, surface) in detected.active.surfaces.iter().enumerate() {
            let Some((positions, carried)) = detected.surface(surface) else { continue };
            let state = detected.states.get(surface.entity);
            bodies.push(Self {
                place,
                surface,
                positions,
                balls: if by_balls[place] { carried.balls } else { &[] },
                caps: by_caps[place].then_some(Caps {
                    curvature: carried.curvature,
                    spheres: carried.spheres,
                    cones: carried.cones,
                }),
                tree: state.filter(|state| state.is_tree_current()).map(SurfaceState::tree),
                #[cfg(feature = "rerun")]
                flat_regions: state.map(SurfaceState::flat_regions).unwrap_or_default(),
            });
        }
        bodies
    }

    /// The triangles that are shown at a level of detail.
    pub(super) fn triangles(&self, level: LevelOfDetail, touches: &Touches) -> Vec<u32> {
        touches.triangles(level, self.place)
    }

    /// The spheres of the triangles that are shown at a level of detail, with the triangles.
    pub(super) fn spheres(&self, level: LevelOfDetail, touches: &Touches) -> Vec<(u32, Ball)> {
        let of_triangle = |triangle: u32| {
            let balls = self.balls.get(triangle as usize).copied();
            let offset = self.caps_of(triangle).map(|cap| Ball { center: cap.center, radius: cap.radius });
            offset.chain(balls).map(move |ball| (triangle, ball))
        };
        self.triangles(level, touches).into_iter().flat_map(of_triangle).collect()
    }

    /// The cones of the triangles that are shown at a level of detail, with the triangles.
    pub(super) fn cones(&self, level: LevelOfDetail, touches: &Touches) -> Vec<(u32, Cap)> {
        self.triangles(level, touches)
            .into_iter()
            .flat_map(|triangle| self.caps_of(triangle).map(move |cap| (triangle, cap)))
            // A cone that contains every direction has no shape.
            .filter(|(_, cap)| cap.cosine > SafetyCones::EVERYWHERE)
            .collect()
    }

    /// The cap of a triangle, and for a sheet the cap on its other side.
    fn caps_of(&self, triangle: u32) -> impl Iterator<Item = Cap> {
        let both = self.caps.map(|Caps { spheres, cones, .. }| {
            let cap = Cap::of(spheres, cones, triangle as usize);
            let behind = cap.in_plane_center() - cap.axis;
            [Some(cap), (!self.surface.one_sided && cap.height > 0.0).then(|| cap.facing(behind))]
        });
        both.into_iter().flatten().flatten()
    }

    pub(super) fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.surface.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }
}

impl Caps<'_> {
    /// The color of a triangle's curvature.
    pub(super) fn curvature_color(&self, triangle: u32, threshold: f32) -> colors::Color {
        let [curvature, radius, height] = [&self.curvature.curvatures, &self.spheres.radii, &self.spheres.heights]
            .map(|numbers| numbers[triangle as usize]);
        // Normalized like the curvature factor: at 1 and −1 the sphere is no longer offset.
        colors::curvature(curvature * (radius * radius - height * height).max(0.0).sqrt() / threshold)
    }

    /// The ages of the recipes of these triangles' spheres, in ticks.
    pub(super) fn recipe_ages(&self, triangles: &[u32]) -> Vec<u32> {
        let all: Vec<u32> = self.spheres.recipe_ages().collect();
        // Osculating spheres have no recipes, and are made in every tick.
        triangles.iter().map(|&triangle| all.get(triangle as usize).copied().unwrap_or(0)).collect()
    }
}
